"""A nominal plant and its loops as systems of python-control, with what is read from them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fdbench.record import FloatArray
from fdbench.simulate.stability import check_finite, check_loop, gain_margin, is_stable

if TYPE_CHECKING:
    import control

ComplexArray = NDArray[np.complex128]
POINTS, LOWEST = 4000, 1e-6  # of a frequency response, and its lowest frequency in halves of the sampling rate
HALF_POWER = math.sqrt(0.5)
FREE_PER_S = 1e-6  # magnitude of a pole, below which it is an integrator's with rounding errors
SETTLED, STEP_SAMPLES = 5.0, (100, 100_000)  # time constants of the slowest mode that a step is drawn for


@dataclass(frozen=True, kw_only=True)
class Pole:
    """One pole with Im >= 0: frequency |s| / 2 pi, damping ratio -Re s / |s|; 0 Hz and NaN for an integrator."""

    frequency_Hz: float
    damping_ratio: float


@dataclass(frozen=True, kw_only=True)
class Margins:
    """How far a loop is from instability, and how fast it is.

    Parameters
    ----------
    stable : bool
        Whether it is, once closed.
    gain_margin : float
        Gain nearest to 1 that changes that, see `fdbench.simulate.stability.gain_margin`.
    phase_margin_rad, crossover_Hz : float
        Smallest distance of the phase from -pi where the gain is 1, and where that is; NaN where it never is 1.
    delay_margin_s : float
        Further dead time that uses up the phase margin.
    bandwidth_Hz : float
        Where the closed loop's gain has fallen by 3 dB below its value at the lowest frequency; NaN if it does not.
    sensitivity_peak : float
        Largest magnitude of 1 / (1 + L): the inverse of the distance of the Nyquist curve from -1.
    """

    stable: bool
    gain_margin: float
    phase_margin_rad: float
    crossover_Hz: float
    delay_margin_s: float
    bandwidth_Hz: float
    sensitivity_peak: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystem:
    r"""A nominal plant, linear, and its control loops.

    Attributes
    ----------
    plant : control.StateSpace
        Continuous, inputs and outputs named with their units, without its dead time.
    delay_s : float
        Dead time before the plant.
    sampling_time_s : float
    loops : mapping of str to control.StateSpace
        Open loops L(z), each to be closed by negative unit feedback; none where the plant has no controller.
    closed : control.StateSpace or None
        From the commanded position, velocity and acceleration to the position that closes the loop.

    Raises
    ------
    SpecError
        If a matrix holds what is no number.

    Examples
    --------
    2 kg on a spring of 200 N/m with a damper of 2 N s/m: 10 rad/s and a damping ratio of 0.05, 5 mm for one newton.

    >>> A, B, C = np.array([[0.0, 1.0], [-100.0, -1.0]]), np.array([[0.0], [0.5]]), np.array([[1.0, 0.0]])
    >>> system = continuous(A, B, C, ["force_N"], ["position_m"], 1e-3)
    >>> system.modes()
    [Pole(frequency_Hz=1.59154, damping_ratio=0.05)]
    >>> round(float(abs(system.plant_response(np.array([1e-6]))[0, 0, 0])), 6)
    0.005
    """

    plant: "control.StateSpace"
    sampling_time_s: float
    delay_s: float = 0.0
    loops: Mapping[str, "control.StateSpace"] = field(default_factory=dict)
    closed: "control.StateSpace | None" = None

    def __post_init__(self) -> None:
        for name, system in {"plant": self.plant, **self.loops, "closed loop": self.closed}.items():
            if system is not None:
                check_finite(name, system.A, system.B, system.C, system.D)

    @property
    def frequencies_Hz(self) -> FloatArray:
        """Frequencies of a response, up to half the sampling rate."""
        highest = 0.5 / self.sampling_time_s
        return np.geomspace(LOWEST * highest, highest, POINTS)

    def modes(self) -> list[Pole]:
        """Return the modes of the plant alone, slowest first."""
        return modes(self.plant.poles())

    def closed_modes(self) -> list[Pole]:
        """Return the modes of the closed loop, slowest first; a pole at z = 0, which is a delay, is left out."""
        if self.closed is None:
            return []
        poles = self.closed.poles()
        return modes(np.log(poles[np.abs(poles) > 1e-9].astype(complex)) / self.sampling_time_s)

    def plant_response(self, frequencies_Hz: FloatArray) -> ComplexArray:
        """Return the continuous plant's response with its dead time, (n_outputs, n_inputs, n_frequencies)."""
        s = 2j * np.pi * frequencies_Hz
        return np.asarray(response(self.plant, s) * np.exp(-s * self.delay_s), dtype=np.complex128)

    def loop_response(self, name: str, frequencies_Hz: FloatArray) -> ComplexArray:
        """Return L (n_frequencies,) of a loop."""
        return np.asarray(response(self.loops[name], self._z(frequencies_Hz))[0, 0], dtype=np.complex128)

    def tracking(self, frequencies_Hz: FloatArray) -> ComplexArray | None:
        r"""Return position over commanded position (n_frequencies,), or None where no motion is controlled.

        The commanded velocity and acceleration are its derivatives, :math:`j \omega` and :math:`-\omega^2` times it.
        """
        if self.closed is None:
            return None
        s = 2j * np.pi * frequencies_Hz
        of_position, of_velocity, of_acceleration = response(self.closed, self._z(frequencies_Hz))[0]
        return np.asarray(of_position + s * of_velocity + s**2 * of_acceleration)

    def margins(self, name: str) -> Margins:
        """Return the margins of a loop."""
        import control

        loop, at_Hz = self.loops[name], self.frequencies_Hz
        L = self.loop_response(name, at_Hz)
        A, B, C = np.asarray(loop.A), np.asarray(loop.B)[:, 0], np.asarray(loop.C)[0]
        _, phase, _, _, crossover, _ = control.stability_margins(control.frd(L, 2.0 * np.pi * at_Hz))
        phase_rad, crossover_Hz = math.radians(phase), crossover / (2.0 * math.pi)
        is_crossed = math.isfinite(crossover_Hz)
        closed = np.abs(L / (1.0 + L))
        below = np.flatnonzero(closed < HALF_POWER * closed[0])
        return Margins(
            stable=is_stable(A - np.outer(B, C)),
            gain_margin=gain_margin(A, B, C),
            phase_margin_rad=phase_rad if is_crossed else math.nan,
            crossover_Hz=crossover_Hz,
            delay_margin_s=phase_rad / (2.0 * math.pi * crossover_Hz) if is_crossed else math.nan,
            bandwidth_Hz=float(at_Hz[below[0]]) if len(below) else math.nan,
            sensitivity_peak=float(np.max(np.abs(1.0 / (1.0 + L)))),
        )

    def check(self) -> None:
        """Raise a SpecError where all loops together, the last one, are unstable; see `check_loop`."""
        for loop in list(self.loops.values())[-1:]:
            check_loop(np.asarray(loop.A), np.asarray(loop.B)[:, 0], np.asarray(loop.C)[0], self.sampling_time_s)

    def step(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return time (s) and answer of a closed loop to a unit step, (n,) both, until its slowest mode has settled."""
        import control

        closed = control.feedback(self.loops[name])
        sizes = np.abs(closed.poles())
        decays = -np.log(sizes[(sizes > 1e-9) & (sizes < 1.0 - 1e-7)])
        n = int(np.clip(SETTLED / decays.min(initial=1.0), *STEP_SAMPLES))
        time_s, answer = control.step_response(closed, np.arange(n) * self.sampling_time_s)
        return np.asarray(time_s), np.asarray(answer)

    def _z(self, frequencies_Hz: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(2j * np.pi * frequencies_Hz * self.sampling_time_s), dtype=np.complex128)


@runtime_checkable
class LinearisedPlant(Protocol):
    """A plant whose nominal model is linear, or about its operating point."""

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the plant and its loops at a sampling time."""
        ...


def continuous(
    A: FloatArray, B: FloatArray, C: FloatArray, inputs: Sequence[str], outputs: Sequence[str], sampling_time_s: float
) -> LinearSystem:
    """Return a plant without a controller of its own, from (n, n), (n, n_inputs) and (n_outputs, n) arrays."""
    import control

    plant = control.ss(A, B, C, 0, inputs=list(inputs), outputs=list(outputs))
    return LinearSystem(plant=plant, sampling_time_s=sampling_time_s)


def response(system: "control.StateSpace", at: "NDArray[np.complexfloating]") -> ComplexArray:
    """Return the response of a system (n_outputs, n_inputs, n) at points of the plane of s or z."""
    return np.asarray(system(at, squeeze=False), dtype=np.complex128)


def modes(poles: Sequence[complex] | ComplexArray) -> list[Pole]:
    """Return the modes of poles in the plane of s, one for each pair, slowest first.

    >>> modes([-3.0 + 4.0j, -3.0 - 4.0j])
    [Pole(frequency_Hz=0.7957747154594768, damping_ratio=0.6)]
    """
    found = []
    for pole in sorted((complex(pole) for pole in poles), key=abs):
        if pole.imag >= 0.0:
            size = abs(pole)
            is_free = size < FREE_PER_S
            ratio = math.nan if is_free else -pole.real / size
            found.append(Pole(frequency_Hz=0.0 if is_free else size / (2.0 * math.pi), damping_ratio=ratio))
    return found
