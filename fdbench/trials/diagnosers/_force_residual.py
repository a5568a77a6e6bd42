"""The force that the nominal model lacks along the measured motion, and what each effect would give there.

Nothing is simulated and no controller is known: kernels of force effects are evaluated at measured positions, speeds
and forces. What enters elsewhere (transmission, sensors) cannot be seen so.
"""

from collections.abc import Sequence

import numpy as np

from fdbench.diagnosis.judge.force_balance_check import low_pass
from fdbench.diagnosis.model.candidates import Candidate
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.effects import Effect, Port
from fdbench.record import FloatArray

STRIDE = 5  # samples between two of the regression
SEEN = (Port.MOTOR_FORCE, Port.TABLE_FORCE, Port.TABLE_INERTIA, Port.COMMAND)


class InverseMotion:
    """One run as an inverse model sees it: smoothed, differentiated, thinned out."""

    def __init__(self, run: RecordedRun, nominal: Nominal) -> None:
        drive = nominal.drive
        self.period_s = run.period_s
        position = smooth(run.channels["position_m"], run.period_s)
        velocity = np.gradient(position, run.period_s)
        acceleration = np.gradient(velocity, run.period_s)
        # A force is held over a period, so that at a sample it has acted half by what was asked before.
        asked = run.channels["motor_force_N"]
        self.force = 0.5 * (asked + np.concatenate((asked[:1], asked[:-1])))
        self.position, self.velocity, self.acceleration = position, velocity, acceleration
        self.passed_on = self.force - drive.motor.mass_kg * acceleration
        known = sum((self.response(effect) for effect in drive.effects), np.zeros(run.n_samples))
        linear = drive.mass_kg * acceleration + drive.viscous_friction_N_s_per_m * velocity
        self.residual = self.thinned(self.force - linear) - self.thinned(known)

    def thinned(self, values: FloatArray) -> FloatArray:
        """Return smoothed values at each ``STRIDE``-th sample."""
        return smooth(values, self.period_s)[::STRIDE]

    def response(self, effect: Effect) -> FloatArray:
        """Return the force against motion that an effect gives, (n_samples,) N."""
        kind = type(effect)
        kernel, values = kind.kernel.py_func, effect.values()
        entering = {
            Port.MOTOR_FORCE: self.force,
            Port.TABLE_FORCE: self.passed_on,
            Port.TABLE_INERTIA: self.acceleration,
            Port.COMMAND: self.force,
        }[kind.port]
        states: tuple[float, ...] = (0.0,) * len(kind.states)
        n_outputs = 2 if kind.port.is_force else 1
        found = np.empty(len(self.position))
        columns = zip(self.position.tolist(), self.velocity.tolist(), entering.tolist(), strict=True)
        for index, (x, v, u) in enumerate(columns):
            result = kernel((index + 0.5) * self.period_s, self.period_s, x, v, u, *values, *states)
            found[index] = u - result[0] if kind.port is Port.COMMAND else result[0]
            states = tuple(result[n_outputs:])
        return found


def smooth(values: FloatArray, period_s: float) -> FloatArray:
    """Return values low-passed without delay, the ends mirrored; see `fdbench.diagnosis.judge.force_balance_check`.

    >>> bool(np.abs(smooth(np.linspace(0.0, 1.0, 1000), 1e-3) - np.linspace(0.0, 1.0, 1000)).max() < 1e-12)
    True
    """
    n = len(values)
    width = min(n - 1, round(0.2 / period_s))
    padded = np.concatenate(
        (2.0 * values[0] - values[width:0:-1], values, 2.0 * values[-1] - values[-2 : -width - 2 : -1])
    )
    line = np.linspace(padded[0], padded[-1], len(padded))
    gain = low_pass(len(padded), period_s)
    return np.asarray((np.fft.irfft(np.fft.rfft(padded - line) * gain, len(padded)) + line)[width : width + n])


def visible(every: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that act as a force along the measured motion, and in addition to what is known."""
    return [item for item in every if item.kind.port in SEEN and item.replaces is None]
