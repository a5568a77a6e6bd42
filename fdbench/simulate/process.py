"""Slot milling as it is simulated: millimetres and newtons inside, as in Turkay and Ulsoy (1988), SI outside."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.effects import Effect
from fdbench.effects._functions import power
from fdbench.errors import SpecError
from fdbench.simulate.exponential import exponential
from fdbench.simulate.random import RandomNumbers, RandomSource
from fdbench.simulate.system import FloatArray, Setup, System, check_table_forces

LONGEST_SUBSTEP_S = 5e-3


@dataclass(frozen=True, kw_only=True)
class Process:
    r"""Force response x_1 to the chip-load term w, and how w follows from the feedrate u in mm/s.

    .. math::
        \dot x_1 = -c_1 x_1 + x_2 + K c_1 w, \quad \dot x_2 = -c_2 x_1 + K c_2 w, \qquad
        w = u^\alpha \;\text{ or }\; w = u_0^\alpha + \alpha u_0^{\alpha - 1} (u - u_0)

    Source: Turkay and Ulsoy (1988), eq. (8).
    """

    c_1: float
    c_2: float
    force: float  # K = K_s a^beta, N at 1 mm/s
    exponent: float
    operating_feedrate: float
    steady_force: float
    linearised: bool
    feedrate_limit: float
    force_limit: float

    def values(self) -> FloatArray:
        """Return what the stepper needs: exponent, line offset + slope * u, switch, limits and steady force."""
        slope = self.exponent * self.operating_feedrate ** (self.exponent - 1.0)
        offset = self.operating_feedrate**self.exponent - slope * self.operating_feedrate
        limits = self.feedrate_limit, self.force_limit
        return np.array([self.exponent, offset, slope, float(self.linearised), *limits, self.steady_force])

    def propagators(self, h: float) -> FloatArray:
        r"""Return (2, 5): exact flow of x over h, and the weights of w at the start, middle and end of the substep.

        The weights are :math:`\int_0^h e^{A (h - \tau)} B\, l_j(\tau)\, d\tau` with the Lagrange parabolas l_j.
        """
        generator = np.zeros((5, 5))
        generator[0] = [-self.c_1, 1.0, self.force * self.c_1, 0.0, 0.0]
        generator[1] = [-self.c_2, 0.0, self.force * self.c_2, 0.0, 0.0]
        generator[2, 3] = generator[3, 4] = 1.0
        flow: FloatArray = exponential(generator * h)[:2]
        slope, bend = flow[:, 3] / h, 4.0 * flow[:, 4] / h**2
        weights = flow[:, 2] - 3.0 * slope + bend, 4.0 * slope - 2.0 * bend, bend - slope
        return np.column_stack((flow[:, :2], *weights))


@kept
@njit(error_model="numpy", forceinline=True)
def chip_load(u, alpha, offset, slope, linear):  # type: ignore[no-untyped-def]
    """Return the chip-load term w of a feedrate in mm/s."""
    return offset + slope * u if linear else power(u, alpha)


@kept
@njit(error_model="numpy")
def advance(state, count, diverged, action, nodes, added, noise, flow, law, out):  # type: ignore[no-untyped-def]
    """Advance every lane by ``len(out)`` samples; lanes are innermost, and each has the bits of a single one.

    Parameters
    ----------
    state, count, diverged : (2, n_lanes), (n_lanes,), (n_lanes,) arrays, changed in place
    action : (n_lanes,) array, m/s
    nodes : (n_samples, 2 substeps + 1) array
        Commanded feedrate, m/s, at both ends and the middle of each substep.
    added : (n_samples,) array
        Force that effects add to the reading, N.
    noise : (n, n_lanes) array
        Noise of the reading, N.
    flow, law : arrays of `Process.propagators` and `Process.values`
    out : (n, 5, n_lanes) array, written
        Steady force (N), feedrate (m/s), force read (N), force added (N), diverged.
    """
    n_lanes, last = out.shape[2], nodes.shape[1] - 1
    alpha, offset, slope, linear = law[0], law[1], law[2], law[3] > 0.5
    feedrate_limit, force_limit, steady = law[4], law[5], law[6]
    a_11, a_12, b_10, b_11, b_12 = flow[0, 0], flow[0, 1], flow[0, 2], flow[0, 3], flow[0, 4]
    a_21, a_22, b_20, b_21, b_22 = flow[1, 0], flow[1, 1], flow[1, 2], flow[1, 3], flow[1, 4]
    x_1, x_2 = state[0], state[1]
    u_0, u_1, u_2, w = np.empty(n_lanes), np.empty(n_lanes), np.empty(n_lanes), np.empty(n_lanes)
    inside = np.empty(n_lanes, dtype=np.bool_)
    for k in range(out.shape[0]):
        for lane in range(n_lanes):
            row = count[lane] + k
            u_0[lane] = 1e3 * (nodes[row, 0] + action[lane])
            reading = x_1[lane] + added[row] + noise[k, lane]
            inside[lane] = (abs(reading) <= force_limit) & (abs(u_0[lane]) <= feedrate_limit)
            out[k, 0, lane] = steady
            out[k, 1, lane] = nodes[row, 0] + action[lane]
            out[k, 2, lane] = reading
            out[k, 3, lane] = added[row]
        for lane in range(n_lanes):
            w[lane] = chip_load(u_0[lane], alpha, offset, slope, linear)
            inside[lane] &= linear | (u_0[lane] > 0.0)
        for node in range(1, last, 2):
            for lane in range(n_lanes):  # apart, since reading places that are known at run time is no vector's work
                row = count[lane] + k
                u_1[lane] = 1e3 * (nodes[row, node] + action[lane])
                u_2[lane] = 1e3 * (nodes[row, node + 1] + action[lane])
            for lane in range(n_lanes):
                w_1 = chip_load(u_1[lane], alpha, offset, slope, linear)
                w_2 = chip_load(u_2[lane], alpha, offset, slope, linear)
                defined = linear | (min(u_1[lane], u_2[lane]) > 0.0)
                inside[lane] &= (abs(u_2[lane]) <= feedrate_limit) & defined
                first = a_11 * x_1[lane] + a_12 * x_2[lane]
                first += b_10 * w[lane] + b_11 * w_1 + b_12 * w_2
                second = a_21 * x_1[lane] + a_22 * x_2[lane]
                second += b_20 * w[lane] + b_21 * w_1 + b_22 * w_2
                x_1[lane], x_2[lane], w[lane] = first, second, w_2
        for lane in range(n_lanes):
            diverged[lane] = diverged[lane] | (not inside[lane])
            out[k, 4, lane] = 1.0 if diverged[lane] else 0.0
    for lane in range(n_lanes):
        count[lane] += out.shape[0]


class SlotMillingSystem(System):
    """Lanes of one slot-milling process; without noise of the force reading every seed gives the same.

    Effects on the table add their force, at the commanded position and feedrate, to the dynamometer's reading.

    Parameters
    ----------
    process : Process
        Its steady force at the operating point is the reference, which is what an adaptive control holds.
    setup : Setup
    hold_input : bool
        Whether the command is held over each sampling time; else it varies within.
    n_lanes : int
    """

    action_names = ("feedrate_m_per_s",)
    columns = ("reference_force_N", "feedrate_m_per_s", "force_N")

    def __init__(self, process: Process, setup: Setup, hold_input: bool, n_lanes: int = 1) -> None:
        timing = setup.timing
        h = timing.substep_s
        if h > LONGEST_SUBSTEP_S * (1.0 + 1e-9) and not hold_input:
            least = math.ceil(timing.sampling_time_s / LONGEST_SUBSTEP_S * (1.0 - 1e-9))
            raise SpecError(
                f"timing.substeps: a substep of {h:g} s is too long for the power law; the longest is "
                f"{LONGEST_SUBSTEP_S:g} s, so at least {least} substeps are needed."
            )
        setup.noise.check_only(("force_N",), "slot milling")
        self._force_noise_N = setup.noise.force_N
        sources = [RandomSource(stream="force_noise", column=0)] if self._force_noise_N > 0.0 else []
        self._numbers = RandomNumbers(sources, n_lanes, n_lanes, 1)
        super().__init__(n_lanes, timing.n_samples, self._numbers)
        per_sample = 2 * timing.substeps
        fine = setup.motion.reference(h / 2.0, self.n_samples * per_sample + 1)
        index = np.arange(self.n_samples)[:, None] * per_sample
        self._nodes = np.ascontiguousarray(
            fine[index + (np.zeros(per_sample + 1, dtype=np.intp) if hold_input else np.arange(per_sample + 1)), 1]
        )
        if not process.linearised and self._nodes.min() <= 0.0:
            raise SpecError(
                f"motion: the feedrate falls to {self._nodes.min():g} m/s, where the power law of the force is "
                "undefined; a positive feedrate is needed, so raise the mean or lower the amplitude."
            )
        self._added = added_force(setup.unmodelled, timing.sampling_time_s, h, fine[index[:, 0]])
        self.truth_columns = ("disturbance_N", "diverged") if setup.unmodelled else ("diverged",)
        self._pick = np.array([0, 1, 2, 3, 4] if setup.unmodelled else [0, 1, 2, 4])
        self.commanded = {"reference_force_N": np.full(self.n_samples, process.steady_force)}
        self.limits = {
            "reference_force_N": process.force_limit,
            "feedrate_m_per_s": 1e-3 * process.feedrate_limit,
            "force_N": process.force_limit,
        }
        self.at_rest = np.array([process.steady_force, self._nodes[0, 0], 0.0])
        self._flow, self._law = process.propagators(h), process.values()
        self._state = np.zeros((2, n_lanes))
        self._count = np.zeros(n_lanes, dtype=np.intp)

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to zero force."""
        self._state[:, lanes] = 0.0
        self._count[lanes] = 0

    def _act(self, action: FloatArray | None) -> None:
        self._action = np.zeros(self.n_lanes) if action is None else np.asarray(action, dtype=np.float64)

    def _advance(self, rows: FloatArray) -> None:
        n_samples, first = len(rows), self._numbers.position
        noise = self._force_noise_N * self._numbers.normal[0, first : first + n_samples, 0]
        out = np.empty((n_samples, 5, self.n_lanes))
        lanes = self._state, self._count, self._diverged, self._action
        advance(*lanes, self._nodes, self._added, noise, self._flow, self._law, out)
        rows[:] = out[:, self._pick]


def added_force(effects: Sequence[Effect], period_s: float, h: float, reference: FloatArray) -> FloatArray:
    """Return the sum of the effects' forces (n_samples,) at the instants of the samples, N.

    Raises
    ------
    SpecError
        If an effect is no force on the table, is random, or has internal states.
    """
    check_table_forces(effects, "slot milling")
    total = np.zeros(len(reference))
    for effect in effects:
        kernel, values = type(effect).kernel, effect.values()
        for k, (position, feedrate, _) in enumerate(reference.tolist()):
            total[k] += kernel(k * period_s, h, position, feedrate, 0.0, *values)[0]
    return total
