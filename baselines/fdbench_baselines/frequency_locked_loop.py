"""Frequency-locked loop: oscillators that follow a periodic force and find its frequency, from the sheet alone."""

import math
from array import array
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, OnlineEstimator, Sample
from fdbench.plants.feed_drive import FeedDrive
from fdbench_baselines._slip import LARGEST_SLIP

LOOP = "velocity_loop"
LOUD = 3.0  # deviations beyond which an error counts no more


@final
class FrequencyLockedLoop(OnlineEstimator):
    r"""Adaptive notch: a bank of oscillators at the harmonics of one frequency, and a loop that locks it to the force.

    .. math::
        \bar z_h = e^{i h \theta} z_h, \qquad e_k = r_k - c - \sum_{h=1}^H \operatorname{Re} \bar z_h, \qquad
        z_h = \bar z_h + 2 \mu \psi(e_k), \qquad c \leftarrow c + \mu \psi(e_k)

    .. math::
        \theta \leftarrow \theta - \mu^2 \psi(e_k)
            \frac{\sum_h h \operatorname{Im} \bar z_h}{\sum_h h^2 |z_h|^2 + s^2}, \qquad \mu = 1 - e^{-T / \tau}

    with what the nominal equation leaves of a row, :math:`r_k = y_k - z_k^T \beta_0`; the angle of a sample
    :math:`\theta`, at first that of the nominal period and never more than 1.5 % from it; an offset c, which keeps
    friction out of the oscillators; and the mean square error s^2, remembered for :math:`\tau` too, beyond three roots
    of which, as it was before the row, :math:`\psi` holds an error. From r to e the bank is a notch at each harmonic,
    :math:`1 / (\pi \tau)` Hz wide.

    For a phase error :math:`\varphi` of the first oscillator the mean of both lines is

    .. math:: \dot \varphi = \Delta \omega - \varphi / \tau, \qquad
              \Delta \dot \omega = -\varphi / (2 \tau^2)

    a second-order loop of damping :math:`1 / \sqrt 2`, whose natural frequency is :math:`1 / (\sqrt 2 \tau)`: a steady
    slip leaves no error, a drift of the frequency leaves the phase :math:`2 \tau^2 \dot \omega`.

    Told: the data sheet and the period. ``disturbance_N`` is the sum of the oscillators after each row by the sheet's
    disturbance gain, ``output`` the row as predicted. No parameters are claimed, nor any mean force. A row costs O(H),
    about 15 us in NumPy; the memory is H complex numbers and 3, beside 16 bytes a row for the answer.

    Parameters
    ----------
    memory_s : float
        :math:`\tau`, above 0: longer for less noise, shorter for a force that comes and goes.
    harmonics : int
        H, at least 1; in inverse dynamics those below half of the sampling frequency. In a velocity loop faster ones
        are found where they fold to.

    Raises
    ------
    SpecError
        If an argument is out of bounds.
    PluginError
        If a sample comes before ``start``.

    Validity
    --------
    What the sheet has wrong of the inertia is in the force, in proportion: a mass 5 % off makes it 5 % too large or
    small. A jerk of the axis rings in the oscillators for :math:`\tau`. A frequency that is further off than the notch
    is wide is found slowly, and harmonics that fold to near 0 or onto each other are not told from friction or from one
    another. While nothing is periodic the angle wanders within its bounds.

    References
    ----------
    Regalia, An improved lattice-based adaptive IIR notch filter, IEEE Trans. Signal Processing 39 (1991), 2124-2128;
    Mojiri and Bakhshai, An adaptive notch filter for frequency estimation of a periodic signal, IEEE Trans. Automatic
    Control 49 (2004), 314-318; Rodriguez et al., Multiresonant frequency-locked loop, IEEE Trans. Industrial
    Electronics 58 (2011), 127-138, for the bank and its normalised loop. Turning oscillators, offset and bound of the
    error are ours.

    Examples
    --------
    A drive that is as its data sheet says, beside a shaker of 5 N, whose period is 65 ms and is told 0.3 % shorter.

    >>> from dataclasses import replace
    >>> from fdbench_baselines._example import example_drive
    >>> context, record = example_drive(wave_N=5.0, period_s=0.065)
    >>> context = replace(context, disturbance_period_s=0.0648)
    >>> found = FrequencyLockedLoop(harmonics=1).fit(context, record)
    >>> error = found.disturbance_N - 5.0 * np.sin(2.0 * np.pi * record["time_s"][:-1] / 0.065)
    >>> bool(np.abs(error[-50:]).max() < 0.05)
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive",)

    def __init__(self, memory_s: float = 0.3, harmonics: int = 4) -> None:
        if not 0.0 < memory_s < math.inf:
            raise SpecError(f"frequency_locked_loop: memory_s = {memory_s!r} must be above 0 and finite.")
        if not isinstance(harmonics, int) or harmonics < 1:
            raise SpecError(f"frequency_locked_loop: harmonics = {harmonics!r} must be an integer of at least 1.")
        self.memory_s, self.harmonics = memory_s, harmonics
        self._z: NDArray[np.complex128] | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where there is no equation of a force on a feed drive, or nothing to lock to."""
        if not isinstance(context.plant, FeedDrive):
            return "the plant is no feed drive"
        if not context.nominal:
            return "the plant's model has no parameters"
        return "no period is known: there is nothing to lock to" if context.disturbance_period_s is None else None

    def start(self, context: Context) -> None:
        """Forget everything; the oscillators are at rest, at the nominal frequency."""
        plant, reason, period_s = context.plant, self.skip(context), context.disturbance_period_s
        if reason is not None or period_s is None or not isinstance(plant, FeedDrive):
            raise SpecError(f"frequency_locked_loop: {reason}.")
        protocol, step_s, count = plant.inverse_dynamics, context.sampling_time_s, self.harmonics
        if context.model != LOOP:
            step_s *= protocol.decimation if protocol is not None else 1
            count = max(1, min(count, int(0.5 * period_s / step_s * (1.0 - LARGEST_SLIP))))
        self._nominal = np.array(list(context.nominal.values()))
        self._orders = np.arange(1, count + 1)
        self._angle = self._told = 2.0 * math.pi * step_s / period_s
        self._share = 1.0 - math.exp(-step_s / self.memory_s)
        self._offset = self._square = 0.0
        self._rows = array("d")
        self._z = np.zeros(count, dtype=np.complex128)

    def update(self, sample: Sample) -> None:
        """Take in a row."""
        z, orders, share = self._started(), self._orders, self._share
        z = z * np.exp(1j * self._angle * orders)
        left = sample.target - float(sample.regressors @ self._nominal)
        error = left - self._offset - float(z.real.sum())
        bound = LOUD * math.sqrt(self._square)
        held = min(max(error, -bound), bound)
        self._square += share * (error * error - self._square)
        power = float(orders**2 @ (z.real**2 + z.imag**2)) + self._square
        if power > 0.0:
            angle = self._angle - share**2 * held * float(orders @ z.imag) / power
            slip = LARGEST_SLIP * self._told
            self._angle = min(max(angle, self._told - slip), self._told + slip)
        self._offset += share * held
        self._z = z + 2.0 * share * held
        self._rows.extend((float(self._z.real.sum()) / sample.disturbance_gain, sample.target - error))

    def estimate(self) -> Estimate:
        """Return the force after each of the rows so far, and the rows as predicted."""
        self._started()
        force, output = np.array(self._rows).reshape(-1, 2).T
        return Estimate(disturbance_N=force, output=output)

    def _started(self) -> NDArray[np.complex128]:
        if self._z is None:
            raise PluginError("frequency_locked_loop: start(context) must come before update and estimate.")
        return self._z
