"""Motor constant: the motor gives less or more force for its current than it did, by the same share everywhere."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, LinearPart, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class MotorConstant(Effect):
    r"""Force constant that is off by a share.

    .. math:: F = (1 + a) F_{asked}

    F: force delivered; F_asked: force asked of the motor, which is logged. Magnets lose about 0.1 % (NdFeB) to 0.2 %
    (ferrite) of it for each kelvin, and for good where they were overheated; an amplifier's measurement of the current
    may be off as well. Every mass, friction and stiffness seems to have changed by the share 1 / (1 + a) - 1.

    Source: Krishnan (2010), Permanent Magnet Synchronous and Brushless DC Motor Drives, on parameter sensitivity.

    Examples
    --------
    >>> MotorConstant.kernel(0.0, 1e-4, 0.0, 0.0, 500.0, *MotorConstant(relative_change=-0.1).values())
    (450.0,)
    """

    port = Port.COMMAND
    rank = 4
    amplitude = "relative_change"
    scales_every_value = True
    confusable_with = ("inertia_mismatch",)

    relative_change: float = parameter("a", low=-0.9, high=1.0, typical=-0.1)

    @kernel
    def kernel(t, h, x, v, u, a):
        return (u * (1.0 + a),)

    def linear_part(self) -> LinearPart:
        return LinearPart(numerator=(1.0 + self.relative_change,))
