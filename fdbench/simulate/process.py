"""Slot milling as it is simulated: millimetres and newtons inside, as in Turkay and Ulsoy (1988), SI outside."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept
from fdbench.effects import Effect
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
@njit(error_model="numpy")
def advance(state, count, diverged, action, nodes, added, noise, flow, law, out):  # type: ignore[no-untyped-def]
    """Advance every lane by ``len(out)`` samples; lane by lane, so that each has the bits of a single one.

    Parameters
    ----------
    state, count, diverged : (n_lanes, 2), (n_lanes,), (n_lanes,) arrays, changed in place
    action : (n_lanes,) array, m/s
    nodes : (n_samples, 2 substeps + 1) array
        Commanded feedrate, m/s, at both ends and the middle of each substep.
    added : (n_samples,) array
        Force that effects add to the reading, N.
    noise : (n_lanes, n) array
        Noise of the reading, N.
    flow, law : arrays of `Process.propagators` and `Process.values`
    out : (n, 5, n_lanes) array, written
        Steady force (N), feedrate (m/s), force read (N), force added (N), diverged.
    """
    alpha, offset, slope = law[0], law[1], law[2]
    linear = law[3] > 0.5
    feedrate_limit, force_limit = law[4], law[5]
    last = nodes.shape[1] - 1
    for lane in range(out.shape[2]):
        x_1, x_2 = state[lane, 0], state[lane, 1]
        for k in range(out.shape[0]):
            row = count[lane] + k
            u = 1e3 * (nodes[row, 0] + action[lane])
            w = offset + slope * u if linear else max(u, 0.0) ** alpha
            inside = abs(u) <= feedrate_limit and (linear or u > 0.0)
            reading = x_1 + added[row] + noise[lane, k]
            for node in range(1, last, 2):
                middle = 1e3 * (nodes[row, node] + action[lane])
                end = 1e3 * (nodes[row, node + 1] + action[lane])
                w_middle = offset + slope * middle if linear else max(middle, 0.0) ** alpha
                w_end = offset + slope * end if linear else max(end, 0.0) ** alpha
                inside = inside and abs(end) <= feedrate_limit and (linear or min(middle, end) > 0.0)
                x_3 = flow[0, 0] * x_1 + flow[0, 1] * x_2
                x_3 += flow[0, 2] * w + flow[0, 3] * w_middle + flow[0, 4] * w_end
                x_2 = flow[1, 0] * x_1 + flow[1, 1] * x_2
                x_2 += flow[1, 2] * w + flow[1, 3] * w_middle + flow[1, 4] * w_end
                x_1, w = x_3, w_end
            if not (inside and abs(reading) <= force_limit):
                diverged[lane] = True
            out[k, 0, lane] = law[6]
            out[k, 1, lane] = nodes[row, 0] + action[lane]
            out[k, 2, lane] = reading
            out[k, 3, lane] = added[row]
            out[k, 4, lane] = 1.0 if diverged[lane] else 0.0
        state[lane, 0], state[lane, 1] = x_1, x_2
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
        self._numbers = RandomNumbers(sources, n_lanes, 1, 1)
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
        self._state = np.zeros((n_lanes, 2))
        self._count = np.zeros(n_lanes, dtype=np.intp)

    def _reset(self, lanes: NDArray[np.intp], seeds: Sequence[int]) -> None:
        """Put lanes back to zero force."""
        self._state[lanes] = 0.0
        self._count[lanes] = 0

    def _act(self, action: FloatArray | None) -> None:
        self._action = np.zeros(self.n_lanes) if action is None else np.asarray(action, dtype=np.float64)

    def _advance(self, rows: FloatArray) -> None:
        n_samples, first = len(rows), self._numbers.position
        noise = self._force_noise_N * self._numbers.normal[:, first : first + n_samples, 0, 0]
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
