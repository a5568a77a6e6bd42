"""Constant force: gravity on an inclined axis, or the pull of a counterweight."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class ConstantForce(Effect):
    r"""A force that depends on nothing.

    .. math:: F = F_0

    Source: Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS, the offset.

    Examples
    --------
    >>> ConstantForce.kernel(0.0, 1e-4, 0.0, 0.5, 0.0, *ConstantForce(constant_force_N=-3.0).values())
    (-3.0, 0.0)
    """

    port = Port.TABLE_FORCE
    amplitude = "constant_force_N"
    cause_type = "constant_force"
    confusable_with = ("direction_dependent_friction",)
    calibrates = "force_offset"
    usually_known = True

    constant_force_N: float = parameter("F_0", low=-5000.0, high=5000.0, typical=15.0)

    @kernel
    def kernel(t, h, x, v, u, F_0):
        return F_0, 0.0
