"""Force saturation: the iron of the motor saturates, so that a large current gives less force than asked."""

import math
from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class ForceSaturation(Effect):
    r"""Soft saturation at 1/kappa.

    .. math:: F = \frac{F_{asked}}{\sqrt{1 + (\kappa F_{asked})^2}} \approx F_{asked} (1 - \beta F_{asked}^2), \quad
              \beta = \kappa^2 / 2

    F: force delivered; F_asked: force asked of the motor. The force grows with the command everywhere, unlike the cubic
    that it is for small commands.

    Source: Slemon (1992), Electric Machines and Drives, on saturation of iron; the form of the curve is ours.

    Examples
    --------
    Asked for as much as the limit of 2000 N, the motor delivers 1/sqrt(2) of it.

    >>> (force,) = ForceSaturation.kernel(0.0, 1e-4, 0.0, 0.0, 2000.0, *ForceSaturation(saturation_per_N=5e-4).values())
    >>> round(force, 4)
    1414.2136
    """

    port = Port.COMMAND
    rank = 2
    amplitude = "saturation_per_N"

    saturation_per_N: float = parameter("kappa", low=0.0, high=0.1, typical=3e-4)

    @kernel
    def kernel(t, h, x, v, u, kappa):
        share = kappa * u
        return (u / math.sqrt(1.0 + share * share),)
