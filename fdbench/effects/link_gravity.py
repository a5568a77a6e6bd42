"""Gravity of a link: its weight turns the joint that carries it."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class LinkGravity(Effect):
    r"""Torque of the weight of a link, of an unbalanced table or of a workpiece beside its centre.

    .. math:: M(q) = m g l \sin(q + \varphi)

    against motion, on the driven side; q: angle of the axis in rad, which is its way on the arc at a radius of 1 m, on
    which the torque m g l is a force. The angle phi is that from the link that hangs down to the zero of q.

    Source: Siciliano, Sciavicco, Villani, Oriolo (2009), Robotics, section 7.3, the gravity terms.

    Examples
    --------
    >>> effect = LinkGravity.typical(gravity_force_N=12.0, phase_rad=0.0)  # 12 N m
    >>> force, slope = LinkGravity.kernel(0.0, 1e-4, math.pi / 6.0, 0.0, 0.0, *effect.values())
    >>> round(force, 9)
    6.0
    """

    port = Port.TABLE_FORCE
    amplitude = "gravity_force_N"
    cause_type = "force_over_position"
    needs_turn = True
    confusable_with = ("cable_stiffness",)

    gravity_force_N: float = parameter("G", low=0.0, high=5000.0, typical=15.0)
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, G, phi):
        return G * sin(x + phi), 0.0
