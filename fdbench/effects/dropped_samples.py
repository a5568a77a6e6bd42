"""Dropped samples: the logger now and then repeats the last sample."""

from dataclasses import dataclass
from typing import final

from fdbench.effects._effect import Effect, Port, kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class DroppedSamples(Effect):
    r"""Independent loss of samples, each replaced by its predecessor (held).

    .. math:: y_k = y_{k-1} \text{ with probability } p

    y_k: all readings of sample k that are logged. Commanded position and velocity go on, the first sample is never
    lost, and the drive itself is not affected, only its record.

    Source: Sinopoli et al. (2004), IEEE Trans. Automatic Control 49(9), the Bernoulli arrival process.

    Examples
    --------
    >>> DroppedSamples.kernel(0.0, 1e-3, 0.0, 0.0, 0.0, 0.01, *DroppedSamples(drop_probability=0.02).values())
    (1.0,)
    """

    port = Port.LOGGING
    random = True
    amplitude = "drop_probability"

    drop_probability: float = parameter("p", low=0.0, high=0.5, typical=0.01)

    @kernel
    def kernel(t, h, x, v, u, r, p):
        return (1.0 if r < p else 0.0,)
