"""Scale quantisation: the position of the table is read in whole steps."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, parameter
from fdbench.effects.encoder_quantisation import EncoderQuantisation


@final
@dataclass(frozen=True, kw_only=True)
class ScaleQuantisation(Effect):
    r"""Rounding of the reading at the table to the resolution q of its scale.

    .. math:: y = q \lfloor x_t / q + 1/2 \rfloor

    x_t: position of the table before rounding, of a rotary axis the angle of its load; y: reading.

    Source: Widrow, Kollar, Quantization Noise (2008), the rounding quantiser.

    Examples
    --------
    >>> effect = ScaleQuantisation(resolution_m=1e-6)
    >>> (reading,) = ScaleQuantisation.kernel(0.0, 1e-4, 0.0, 0.0, 2.6e-6, *effect.values())
    >>> round(reading * 1e6, 9)
    3.0
    """

    port = Port.TABLE_SCALE
    rank = 1
    amplitude = "resolution_m"
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_resolved_around_its_typical_size": "which step is read hangs on the last bits of the position",
    }

    resolution_m: float = parameter("q", low=0.0, high=1e-3, typical=1e-6)

    kernel = EncoderQuantisation.kernel
