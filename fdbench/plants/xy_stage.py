"""XY stage with a flexible fixture: each axis a sum of vibration modes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import SpecError
from fdbench.plants._servo_stage import StagePlant
from fdbench.simulate.stage import Response
from fdbench.specification import bounded, check_bounds, positive


@final
@dataclass(frozen=True, kw_only=True)
class ServoMode:
    r"""One term :math:`(\alpha + \beta s) / (s^2 + 2 \zeta \omega s + \omega^2)` with :math:`\omega = 2 \pi f`."""

    frequency_Hz: float = positive()
    damping_ratio: float = positive()
    alpha_per_s2: float = bounded(-1e12, 1e12)
    beta_per_s: float = bounded(-1e9, 1e9)

    def __post_init__(self) -> None:
        check_bounds(self)


@final
@dataclass(frozen=True, kw_only=True)
class VibratingAxis:
    """Servo response of the fixture on one axis.

    Parameters
    ----------
    servo_stiffness_N_per_m : float
        Stiffness with which the servo holds the table: a force moves it like a command of force / stiffness.
    modes : tuple of ServoMode
        Terms that add up to the transfer function from commanded position to the fixture's position.
    """

    servo_stiffness_N_per_m: float = positive()
    modes: tuple[ServoMode, ...]

    def __post_init__(self) -> None:
        check_bounds(self)
        if not self.modes:
            raise SpecError("modes: an axis has at least one mode.")

    @property
    def static_gain(self) -> float:
        """Fixture displacement for a command of 1 m at rest, near 1."""
        return sum(mode.alpha_per_s2 / (2.0 * math.pi * mode.frequency_Hz) ** 2 for mode in self.modes)

    def response(self) -> Response:
        """Return the modes side by side, each in observer form; effects act at the commanded position and velocity."""
        n = 2 * len(self.modes)
        A, B, C = np.zeros((n, n)), np.zeros(n), np.tile([1.0, 0.0], len(self.modes))
        for place, mode in zip(range(0, n, 2), self.modes, strict=True):
            omega = 2.0 * math.pi * mode.frequency_Hz
            damping = 2.0 * mode.damping_ratio * omega
            A[place : place + 2, place : place + 2] = [[0.0, 1.0], [-(omega**2), -damping]]
            B[place : place + 2] = mode.beta_per_s, mode.alpha_per_s2 - damping * mode.beta_per_s
        table = np.zeros((3, n + 2))
        table[0, n] = table[1, n + 1] = 1.0
        return Response(A=A, B=B, F=-B / self.servo_stiffness_N_per_m, C=C, table=table)


@final
@dataclass(frozen=True, kw_only=True)
class XYStage(StagePlant):
    r"""Two axes that carry a fixture, whose position is measured.

    .. math:: x = G_{pb}(s)\, (x_d - H / K), \qquad
              G_{pb}(s) = \sum_{i=1}^M \frac{\alpha_i + \beta_i s}{s^2 + 2 \zeta_i \omega_i s + \omega_i^2}

    H is the sum of the effects at the commanded position and velocity, since the nominal model has no position of the
    table; K is the servo's stiffness. The model for estimators is ``servo_response``, with the rows of x before those
    of y; its disturbance gain is the mean of both axes.

    Both axes of the published stage have zeros in the right half-plane: their inverse is not stable.

    Parameters
    ----------
    x, y : VibratingAxis

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eq. (15) and table 1; Okwudire, Ramani, Duan (2016), CIRP Annals 65, 373-376. The
    path of H into the fixture's position is ours.
    """

    x: VibratingAxis
    y: VibratingAxis

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.x.modes) != len(self.y.modes):
            raise SpecError("y.modes: as many as x.modes are needed; add one with alpha = beta = 0 for a missing one.")

    def axes(self) -> Mapping[str, Response]:
        """Return the two axes as ``x_`` and ``y_``."""
        return {"x_": self.x.response(), "y_": self.y.response()}
