"""Encoder interpolation error: the divided signal period of the encoder is not quite even."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from fdbench.effects._effect import Effect, Port, kernel, parameter
from fdbench.effects._functions import sin

TURN = 2.0 * math.pi


@final
@dataclass(frozen=True, kw_only=True)
class EncoderInterpolationError(Effect):
    r"""Error of the motor encoder's reading that repeats with the signal period (sub-divisional error).

    .. math:: y = x + A \sin(2 \pi x / p + \varphi)

    x: true position on the motor side; y: reading. For that of the table see `scale_interpolation_error`.

    Source: Heydemann (1981), Applied Optics 20(19), 3382-3384, on errors of sine and cosine signals.

    Examples
    --------
    >>> effect = EncoderInterpolationError.typical(error_amplitude_m=1e-7, signal_period_m=2e-5, phase_rad=0.0)
    >>> (reading,) = EncoderInterpolationError.kernel(0.0, 1e-3, 0.0, 0.0, 5e-6, *effect.values())
    >>> round(reading * 1e6, 9)
    5.1
    """

    port = Port.MOTOR_ENCODER
    amplitude = "error_amplitude_m"
    everywhere = True
    expected_failures: ClassVar[Mapping[str, str]] = {
        "is_named_first": "at its typical size it is hardly above the noise of that record (probability 0.40)",
    }

    error_amplitude_m: float = parameter("A", low=0.0, high=1e-5, typical=1e-7)
    signal_period_m: float = parameter("p", low=1e-6, high=0.01, typical=2e-5)
    phase_rad: float = parameter("phi", low=-TURN, high=TURN, typical=0.0, phase=True)

    @kernel
    def kernel(t, h, x, v, u, A, p, phi):
        return (u + A * sin(TURN * (u / p) + phi),)
