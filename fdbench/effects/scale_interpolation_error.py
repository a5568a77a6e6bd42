"""Scale interpolation error: the divided signal period of the linear scale is not quite even."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, parameter
from fdbench.effects.encoder_interpolation_error import TURN, EncoderInterpolationError


@final
@dataclass(frozen=True, kw_only=True)
class ScaleInterpolationError(Effect):
    r"""Error of the reading at the table that repeats with the signal period of the scale.

    .. math:: y = x_t + A \sin(2 \pi x_t / p + \varphi)

    x_t: true position of the table, of a rotary axis the angle of its load; y: reading. A loop that is closed over the
    scale follows the error, one that is closed over the motor's encoder does not see it.

    Source: Heydemann (1981), Applied Optics 20(19), 3382-3384, on errors of sine and cosine signals.

    Examples
    --------
    >>> effect = ScaleInterpolationError.typical(error_amplitude_m=1e-7, signal_period_m=2e-5, phase_rad=0.0)
    >>> (reading,) = ScaleInterpolationError.kernel(0.0, 1e-3, 0.0, 0.0, 5e-6, *effect.values())
    >>> round(reading * 1e6, 9)
    5.1
    """

    port = Port.TABLE_SCALE
    amplitude = "error_amplitude_m"
    expected_failures: ClassVar[Mapping[str, str]] = EncoderInterpolationError.expected_failures

    error_amplitude_m: float = parameter("A", low=0.0, high=1e-5, typical=1e-7)
    signal_period_m: float = parameter("p", low=1e-6, high=0.01, typical=2e-5)
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    kernel = EncoderInterpolationError.kernel
