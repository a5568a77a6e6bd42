"""Salehi (2013): force from a spindle's displacement, from a drive's current, and from both in a network of sensors.

The thesis plots its results without figures; the targets are those of a faithful recomputation (see docs/papers).
"""

import dataclasses
from collections.abc import Iterator, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Estimate, estimators
from fdbench.plants import StateSpace, StateSpacePlant
from fdbench.record import FloatArray, Record
from fdbench.reproduce._row import Parts, Row
from fdbench.scenario import Reality, Scenario, load_scenario
from fdbench.simulate.system import Noise
from fdbench.statistics import rms

PAPER = "Salehi 2013"
HALF_POWER = 0.5**0.5
STEP_N = 100.0


def must(item: str, value: float, target: float, tolerance: float, reason: str = "", paper: float | None = None) -> Row:
    """Return a figure that has to hold."""
    return Row(
        paper=PAPER,
        item=item,
        paper_value=paper,
        value=float(value),
        target=target,
        tolerance=tolerance,
        kind="must",
        reason=reason,
    )


def ranking(item: str, holds: bool) -> Row:
    """Return an order that has to hold."""
    return Row(paper=PAPER, item=item, paper_value=None, value=float(holds), target=1.0, tolerance=0.0, kind="ranking")


# ---- scenarios and estimates ----


def scenario_of(name: str, **changes: Any) -> Scenario:
    """Return a scenario with another clock; ``changes`` are fields of its timing."""
    scenario = load_scenario(name)
    if scenario.timing is None:
        raise SpecError(f"{name}: missing table [timing].")
    return dataclasses.replace(scenario, timing=dataclasses.replace(scenario.timing, **changes))


def without_noise(scenario: Scenario) -> Scenario:
    """Return a scenario whose readings are exact."""
    return dataclasses.replace(scenario, reality=dataclasses.replace(scenario.reality, noise=Noise()))


def with_plant(scenario: Scenario, **changes: Any) -> Scenario:
    """Return a scenario with another plant, nominally and in reality."""
    plant: Any = scenario.plant
    return dataclasses.replace(scenario, plant=dataclasses.replace(plant, **changes))


def across_the_feed(scenario: Scenario) -> Scenario:
    """Return milling with the force in the y direction."""
    force: Any = scenario.reality.effects[0]
    effects = (dataclasses.replace(force, direction_rad=0.5 * np.pi),)
    reality: Reality = dataclasses.replace(scenario.reality, effects=effects)
    return dataclasses.replace(scenario, reality=reality)


def estimate(scenario: Scenario, record: Record, name: str = "kalman", **arguments: Any) -> Estimate:
    """Return what an estimator claims."""
    return estimators.get(name)(**arguments).fit(scenario.context(), record)


def force_of(claim: Estimate) -> FloatArray:
    """Return the claimed force; its row k is the estimate at sample k + 1."""
    if claim.disturbance_N is None:
        raise SpecError("the estimator claims no disturbance.")
    return claim.disturbance_N


def deviation_of(claim: Estimate) -> float:
    """Return the standard deviation that is claimed for the last force."""
    if claim.disturbance_variance_N2 is None:
        raise SpecError("the estimator claims no variance.")
    return float(np.sqrt(claim.disturbance_variance_N2[-1]))


def space_of(scenario: Scenario) -> StateSpace:
    """Return the plant in state space."""
    if not isinstance(scenario.plant, StateSpacePlant):
        raise SpecError(f"{scenario.id}: the plant has no state space.")
    return scenario.plant.state_space(scenario.setup.timing.sampling_time_s)


# ---- responses of an estimator as a black box ----


def impulse_response(scenario: Scenario, column: str, size: float, **arguments: Any) -> FloatArray:
    """Return the force that one reading of ``size`` in a column of zeros causes, from the row of that reading on."""
    zeros: FloatArray = np.zeros(scenario.setup.timing.n_samples)
    pulse = zeros.copy()
    pulse[1] = size
    space = space_of(scenario)
    columns = dict.fromkeys((*space.inputs, *space.outputs), zeros) | {column: pulse}
    record = Record({"time_s": clock(len(zeros), scenario.setup.timing.sampling_time_s), **columns})
    return force_of(estimate(scenario, record, **arguments))


def clock(n_samples: int, period_s: float) -> FloatArray:
    """Return the times of the samples."""
    return np.asarray(period_s * np.arange(n_samples), dtype=np.float64)


def step_response(scenario: Scenario, start_s: float, **arguments: Any) -> FloatArray:
    """Return the force from the sample of the step on, without noise."""
    record, _ = without_noise(scenario).observe(0)
    first = round(start_s / scenario.setup.timing.sampling_time_s)
    return force_of(estimate(scenario, record, **arguments))[first - 1 :]


def transfer(weights: FloatArray, period_s: float, frequencies_Hz: FloatArray) -> np.ndarray:
    """Return the transfer function of an impulse response."""
    times = period_s * np.arange(len(weights))
    return np.array([np.exp(-2j * np.pi * f * times) @ weights for f in frequencies_Hz])


def bandwidth_Hz(response: np.ndarray, frequencies_Hz: FloatArray) -> float:
    """Return where the magnitude first falls below -3 dB; infinite if it does not."""
    below = np.flatnonzero(np.abs(response) < HALF_POWER)
    return float(frequencies_Hz[below[0]]) if below.size else float("inf")


def delay_s(response: np.ndarray, frequencies_Hz: FloatArray, at_Hz: float = 50.0) -> float:
    """Return the phase delay at a frequency of the grid."""
    phase = float(np.angle(response[np.argmin(np.abs(frequencies_Hz - at_Hz))]))
    return -phase / (2.0 * np.pi * at_Hz)


# ---- the spindle ----


def spindle_plant() -> Iterator[Row]:
    """Yield static compliances and zeros."""
    scenario = load_scenario("SpindleStep-v0")
    plant: Any = scenario.plant
    parts = [1e6 * mode.compliance_m_per_N for mode in plant.modes]
    for number, (value, target) in enumerate(zip(parts, (1.1506, 3.5462, 0.1167), strict=True), 1):
        yield must(f"spindle: static compliance of mode {number}, um/N", value, target, 6e-5)
    yield must("spindle: static compliance, um/N", 1e6 * plant.static_compliance_m_per_N, 4.81346, 5e-5)
    space = space_of(scenario)
    n = len(space.A)
    pencil = np.block([[space.A, space.E[:, None]], [space.C, np.zeros((1, 1))]])
    zeros = _finite_zeros(pencil, n)
    for zero, wanted in zip(zeros, (-146.1 + 4969.6j, -220.4 + 7286.6j), strict=True):
        yield must(f"spindle: zero near {wanted.imag:.0f} rad/s, real part, 1/s", zero.real, wanted.real, 0.06)
        yield must(f"spindle: zero near {wanted.imag:.0f} rad/s, imaginary part", zero.imag, wanted.imag, 0.06)


def _finite_zeros(pencil: FloatArray, n: int) -> list[complex]:
    """Return the transmission zeros in the upper half plane, by frequency."""
    from scipy.linalg import eigvals

    values = eigvals(pencil, np.diag([1.0] * n + [0.0]))
    finite = [complex(value) for value in values if np.isfinite(value) and abs(value) < 1e6 and value.imag > 0.0]
    return sorted(finite, key=lambda zero: zero.imag)


CONTINUOUS_HZ: FloatArray = np.linspace(10.0, 12000.0, 1200)


def continuous_response(scale: float, q: float) -> tuple[np.ndarray, float, FloatArray]:
    """Return the response from force to claim at `CONTINUOUS_HZ`, the claimed deviation, and the readings' weights.

    The continuous filter is run at 0.2 us, where it does not matter that readings are held, and for 0.1 s, one period
    of the grid. The noise is ``scale`` times 0.1 N at 0.1 ms, as a density.
    """
    period = 2e-7
    scenario = scenario_of("SpindleStep-v0", sampling_time_s=period, duration_s=0.1, substeps=1)
    plant: Any = scenario.plant
    noise = scale * plant.sensor_noise_m * (1e-4 / period) ** 0.5
    scenario = with_plant(scenario, sensor_noise_m=noise)
    arguments: dict[str, Any] = {"q_N2_per_s": q, "form": "continuous"}
    weights = impulse_response(scenario, "displacement_m", 1.0, **arguments)
    space = space_of(scenario)
    eye = np.eye(len(space.A))
    plant_response = np.array(
        [space.C[0] @ np.linalg.solve(2j * np.pi * f * eye - space.A, space.E) for f in CONTINUOUS_HZ]
    )
    zeros: FloatArray = np.zeros(5)
    nothing = Record({"time_s": clock(5, period), "displacement_m": zeros})
    deviation = deviation_of(estimate(scenario, nothing, **arguments))
    of_readings = np.fft.rfft(weights, scenario.setup.timing.n_samples)[1 : len(CONTINUOUS_HZ) + 1]
    return of_readings * plant_response, deviation, weights


def continuous_filter() -> Iterator[Row]:
    """Continuous filter of the spindle: claimed deviation, bandwidth and delay."""
    grid = CONTINUOUS_HZ
    found = {}
    for q, deviation, bandwidth, delay in (
        (1e4, 1.14, 2517.0, 0.130),
        (1e6, 7.85, 5211.0, 0.062),
        (1e8, 53.6, None, 0.029),
    ):
        response, claimed, _ = continuous_response(1.0, q)
        found[q] = response
        item = f"spindle, continuous filter, q {q:g} N^2/s"
        yield must(f"{item}: standard deviation of the force, N", claimed, deviation, 0.02 * deviation)
        yield must(f"{item}: delay at 50 Hz, ms", 1e3 * delay_s(response, grid), delay, max(0.02 * delay, 5e-4))
        if bandwidth is None:
            yield ranking(f"{item}: -3 dB above 10 kHz", bandwidth_Hz(response, grid) > 1e4)
        else:
            yield must(f"{item}: -3 dB, Hz", bandwidth_Hz(response, grid), bandwidth, 0.02 * bandwidth)
        yield must(f"{item}: largest magnitude", float(np.abs(response).max()), 1.0, 0.005)
    _, _, weights = continuous_response(1.0, 1e12)
    early, late = (rms(weights[first : first + 100_000]) for first in (300_000, 400_000 - 1))
    rate = np.log(early / late) / 0.02
    yield must("spindle, continuous filter, q 1e+12 N^2/s: rate of the slowest pole, 1/s", rate, 146.1, 0.5)
    scaled, _, _ = continuous_response(10.0, 1e6)
    difference = float(np.abs(scaled - found[1e4]).max())
    yield must("spindle: ten times the noise with 100 q gives the same response, difference", difference, 0.0, 1e-6)


def spindle_steps() -> Iterator[Row]:
    """Yield what steps of 100 N show of the discrete filter."""
    columns = ("-3 dB, Hz", "delay at 50 Hz, ms", "noise, N", "t90, ms", "settling to 5 %, ms", "overshoot, N")
    nan, inf = float("nan"), float("inf")
    table = (
        (1e-4, "van_loan", 1e2, (1379.0, 0.279, 0.066, 0.4, 0.7, 10.0)),
        (1e-4, "force_only", 1e2, (1379.0, 0.279, 0.066, 0.4, 0.7, 10.0)),
        (1e-4, "van_loan", 1e4, (2480.0, 0.154, 0.40, 0.2, 0.4, 10.0)),
        (1e-4, "force_only", 1e4, (2480.0, 0.154, 0.40, 0.2, 0.4, 10.0)),
        (1e-4, "van_loan", 1e6, (3838.0, 0.117, 1.35, 0.2, 0.4, 15.0)),
        (1e-4, "force_only", 1e6, (4334.0, 0.109, 2.05, 0.2, nan, 12.0)),
        (1e-3, "van_loan", 1e2, (49.0, 3.4, 0.08, 6.0, 16.0, 7.0)),
        (1e-3, "van_loan", 1e8, (49.0, 3.4, 0.08, 6.0, 16.0, 7.0)),
        (1e-3, "force_only", 1e4, (inf, 1.0, 0.40, 1.0, 1.0, 2.0)),
        (1e-3, "force_only", 1e8, (inf, 1.0, 0.43, 1.0, 1.0, 1.0)),
    )
    for period, force_noise, q, targets in table:
        scenario = scenario_of("SpindleStep-v0", sampling_time_s=period, substeps=round(period / 1e-5))
        arguments = {"q_N2_per_s": q, "form": "steady", "force_noise": force_noise}
        plant: Any = scenario.plant
        step = step_response(scenario, 0.1, **arguments)
        grid = np.concatenate(([50.0], np.arange(10.0, 0.5 / period, 1.0)))
        response = transfer(np.diff(step, prepend=0.0) / STEP_N, period, grid)
        noise = impulse_response(scenario, "displacement_m", plant.sensor_noise_m, **arguments)
        outside = np.flatnonzero(np.abs(step - STEP_N) > 0.05 * STEP_N)
        values = (
            bandwidth_Hz(response[1:], grid[1:]),
            1e3 * delay_s(response, grid),
            float(np.sqrt(np.sum(noise**2))),
            1e3 * period * int(np.argmax(step >= 0.9 * STEP_N)),
            1e3 * period * (int(outside[-1]) + 1),
            float(step.max()) - STEP_N,
        )
        # Figures printed with one or two digits are held to half of the last one, overshoots to 1 N.
        floors = (0.0, 0.05 if period > 5e-4 else 0.0, 0.005, 1e-9, 1e-9, 1.0)
        for column, value, target, floor in zip(columns, values, targets, floors, strict=True):
            item = f"spindle, step, {1e3 * period:g} ms, {force_noise}, q {q:g} N^2/s: {column}"
            if np.isinf(target):
                yield ranking(f"{item}: beyond half the sampling rate", np.isinf(value))
            elif not np.isnan(target):
                yield must(item, value, target, max(0.05 * target, floor))
        yield must(
            f"spindle, step, {1e3 * period:g} ms, {force_noise}, q {q:g} N^2/s: bias, N", step[-1] - STEP_N, 0.0, 0.02
        )


def force_at(scenario: Scenario) -> FloatArray:
    """Return the force just after each sample, (n_samples,); the truth of a scenario is its mean over the sample."""
    timing = scenario.setup.timing
    h = timing.sampling_time_s / timing.substeps
    motion = scenario.setup.motion.reference(timing.sampling_time_s, timing.n_samples)
    effect: Any = scenario.reality.effects[0]
    values = effect.values()
    return np.array(
        [
            type(effect).kernel(k * timing.sampling_time_s + 0.5 * h, h, position, velocity, 0.0, *values)[0]
            for k, (position, velocity, _) in enumerate(motion.tolist())
        ]
    )


def milling() -> Iterator[Row]:
    """Milling force and the errors of its estimate."""
    targets = {"X": (41.02, -33.12, 11.50, 26.62), "Y": (164.85, 33.15, 109.34, 38.07)}
    errors: dict[str, float] = {}
    for axis in ("X", "Y"):
        for period in (1e-4, 1e-3):
            scenario = scenario_of("SpindleMilling-v0", sampling_time_s=period, substeps=round(period / 1e-5))
            scenario = across_the_feed(scenario) if axis == "Y" else scenario
            record, _ = scenario.observe(0)
            force = force_at(scenario)
            first = round(0.1 / period)
            if period == 1e-4:
                fine = force_at(scenario_of_fine(scenario))[round(0.1 / 1e-5) :]
                extremes = fine.max(), fine.min(), fine.mean(), fine.std()
                for name, value, target in zip(("max", "min", "mean", "std"), extremes, targets[axis], strict=True):
                    yield must(f"milling force F{axis.lower()}: {name}, N", value, target, 0.01 * abs(target))
                plant: Any = scenario.plant
                static = record["displacement_m"] / plant.static_compliance_m_per_N
                errors[f"{axis} static"] = rms((static - force)[first:]) / rms(force[first:])
            for q, force_noise in ((1e4, "van_loan"), (1e4, "force_only"), (1e6, "van_loan"), (1e8, "force_only")):
                claim = force_of(estimate(scenario, record, q_N2_per_s=q, form="steady", force_noise=force_noise))
                found = np.concatenate(([0.0], claim))
                lags = [rms(found[first:] - force[first - lag : len(force) - lag]) for lag in range(4)]
                key = f"{axis} {1e3 * period:g} {force_noise} {q:g}"
                errors[key], errors[f"{key} lag"] = (x / rms(force[first:]) for x in (lags[0], min(lags[1:])))
                errors[f"{key} N"] = lags[0]
    for item, key, target in (
        ("X, 0.1 ms, q 1e4: error, N", "X 0.1 van_loan 10000 N", 4.75),
        ("Y, 0.1 ms, q 1e4: error, N", "Y 0.1 van_loan 10000 N", 9.3),
        ("X, 0.1 ms, q 1e4: error, share of the force", "X 0.1 van_loan 10000", 0.164),
        ("Y, 0.1 ms, q 1e4: error, share of the force", "Y 0.1 van_loan 10000", 0.080),
        ("X, 0.1 ms, q 1e6: error, share of the force", "X 0.1 van_loan 1e+06", 0.149),
        ("Y, 0.1 ms, q 1e6: error, share of the force", "Y 0.1 van_loan 1e+06", 0.071),
        ("X, static inversion: error, share of the force", "X static", 0.515),
        ("X, 1 ms, van_loan: error, share of the force", "X 1 van_loan 10000", 0.47),
        ("Y, 1 ms, van_loan: error, share of the force", "Y 1 van_loan 10000", 0.23),
        ("X, 1 ms, force_only, q 1e4: error, share of the force", "X 1 force_only 10000", 1.69),
        ("X, 1 ms, force_only, q 1e8: error, share of the force", "X 1 force_only 1e+08", 1.81),
        ("Y, 1 ms, force_only, q 1e4: error, share of the force", "Y 1 force_only 10000", 0.79),
        ("Y, 1 ms, force_only, q 1e8: error, share of the force", "Y 1 force_only 1e+08", 0.85),
    ):
        yield must(f"milling {item}", errors[key], target, 0.05 * target)
    for axis, target in (("X", 0.070), ("Y", 0.034)):
        value = errors[f"{axis} 0.1 van_loan 10000 lag"]
        reason = "depends on where in a sample the teeth enter"
        yield must(
            f"milling {axis}, 0.1 ms, q 1e4: error, best lag of 1 to 3 samples removed",
            value,
            target,
            0.1 * target,
            reason,
        )
    best = errors["X static"] / errors["X 0.1 van_loan 10000"]
    yield ranking("milling X: the filter errs at least 3 times less than the static inversion", best >= 3.0)


def scenario_of_fine(scenario: Scenario) -> Scenario:
    """Return a scenario on a clock of 10 us."""
    timing = dataclasses.replace(scenario.setup.timing, sampling_time_s=1e-5, substeps=1)
    return dataclasses.replace(scenario, timing=timing)


# ---- the drive ----


def drive_current() -> Iterator[Row]:
    """Force from the current of a feed drive: the table of section 4.3 of the digest."""
    table = (
        (1e2, 1.53, 0.998, 25.0, 51.0),
        (1e4, 7.02, 3.46, 6.0, 10.0),
        (1e5, 16.5, 8.0, 4.0, 5.0),
        (1e6, 38.3, 20.2, 3.0, 4.0),
    )
    long = scenario_of("DriveCurrentClosed-v0", duration_s=30.0)
    record, _ = long.observe(0)
    for q, deviation, spread, t63, t90 in table:
        item = f"drive current, q {q:g} N^2/s"
        claim = estimate(long, record, q_N2_per_s=q, form="steady")
        steady = force_of(claim)[2000:]
        step = step_response(long, 0.5, q_N2_per_s=q, form="steady")
        reason = "exact; 0.83 N is one short record" if q == 1e2 else ""
        yield must(f"{item}: claimed standard deviation, N", deviation_of(claim), deviation, 0.05 * deviation)
        yield must(f"{item}: standard deviation once steady, N", float(steady.std()), spread, 0.05 * spread, reason)
        yield must(f"{item}: mean once steady, N", float(steady.mean()), STEP_N, 0.02 * spread + 0.05)
        for share, target in ((0.63, t63), (0.9, t90)):
            value = float(np.argmax(step >= share * STEP_N))
            yield must(f"{item}: t{100 * share:.0f}, ms", value, target, 1.0)
    closed, opened = load_scenario("DriveCurrentClosed-v0"), load_scenario("DriveCurrentOpen-v0")
    forces = [force_of(estimate(case, case.record(0), q_N2_per_s=1e4)) for case in (closed, opened)]
    difference = float(np.abs(forces[0] - forces[1]).max())
    yield must("drive current: closed against open loop, largest difference, N", difference, 0.0, 1e-6)
    nothing = force_of(estimate(closed, closed.record(0), q_N2_per_s=0.0, form="steady"))
    yield must("drive current, q 0: largest force, N", float(np.abs(nothing).max()), 0.0, 1e-9)
    plant: Any = opened.plant
    speed = opened.record(0)["velocity_m_per_s"][-1] * 2.0 * np.pi / plant.motor.lead_m
    yield must("drive current, open loop: speed 1.5 s after the step, rad/s", speed, -24.0, 0.5)
    space = space_of(closed)
    for outputs, rank in (((0, 1), 3), ((1,), 3), ((0,), 2)):
        names = " and ".join(space.outputs[index] for index in outputs)
        yield must(f"drive current: states seen from {names}", observable_states(space, outputs), rank, 0.0)


def observable_states(space: StateSpace, outputs: Sequence[int]) -> int:
    """Return the rank of the observability matrix of states and force."""
    n = len(space.A)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[:n, n] = space.A, space.E * 1e3
    C = np.hstack((space.C[list(outputs)], np.zeros((len(outputs), 1))))
    return int(np.linalg.matrix_rank(np.vstack([C @ np.linalg.matrix_power(A, power) for power in range(n + 1)])))


# ---- the network ----


NODES = (1, 2, 3)
Readings = list[tuple[Record, FloatArray]]


@cache
def network(kind: str = "") -> Scenario:
    """Return a network of sensors whose force is held over each sample of 0.1 ms: all linked, or as a line."""
    return scenario_of(f"SensorNetwork{kind}-v0", substeps=1)


@cache
def readings() -> Readings:
    """Return records of the network and their forces."""
    records: Readings = []
    for seed in range(3):
        record, truth = network().observe(seed)
        if truth.disturbance_N is None:
            raise SpecError("the network has no disturbance.")
        records.append((record, truth.disturbance_N))
    return records


def network_error(scenario: Scenario, records: Readings, name: str, **arguments: Any) -> float:
    """Return the error of a claim from 0.2 s on, as mean over the records, N."""
    errors = []
    for record, force in records:
        claim = force_of(estimate(scenario, record, name, q_N2_per_s=1e5, **arguments))
        errors.append(rms((claim - force[1:])[1999:]))
    return float(np.mean(errors))


def error_of(kind: str, name: str, **arguments: Any) -> float:
    """Return the error of a claim in a kind of network, N."""
    return network_error(network(kind), readings(), name, **arguments)


def against_central(name: str, **arguments: Any) -> float:
    """Return the largest difference of a claim to that of the central filter from 0.2 s on, N."""
    record = readings()[0][0]
    found, central = (
        force_of(estimate(network(), record, kind, q_N2_per_s=1e5, **settings))
        for kind, settings in ((name, arguments), ("kalman_central", {}))
    )
    return float(np.abs(found - central)[1999:].max())


def alone() -> Iterator[Row]:
    """Yield the errors of all readings together and of each on its own."""
    yield must("network: CKF, N", error_of("", "kalman_central"), 12.016, 0.05)
    for node, target, tolerance in ((1, 12.02, 0.05), (2, 35.57, 0.7), (3, 41.52, 0.8)):
        value = network_error(with_plant(network(), links=()), readings(), "kalman_distributed", node=node)
        yield must(f"network: node {node} alone, N", value, target, tolerance, "scatter of the noise")


def linked(label: str, name: str, **arguments: Any) -> Iterator[Row]:
    """Yield how far a filter is from the central one where all nodes hear each other."""
    difference = against_central(name, **arguments)
    yield must(f"network, full: {label} against CKF, largest difference, N", difference, 0.0, 1e-3)


def printed_parallel() -> Iterator[Row]:
    """Yield the parallel filter as printed, and without its weights."""
    yield must("network, full: PIF as printed, N", error_of("", "kalman_parallel", form="printed"), 12.021, 0.05)
    difference = against_central("kalman_parallel", form="printed")
    yield must("network, full: PIF as printed against CKF, largest difference, N", difference, 0.25, 0.05)
    yield must("network, full: PIF by a plain sum, N", error_of("", "kalman_parallel", form="sum"), 13.71, 0.05)


def in_line(label: str, name: str, targets: Sequence[float]) -> Iterator[Row]:
    """Yield the errors of a filter where the node in the middle hears both others."""
    for node, target in zip(NODES, targets, strict=True):
        value = error_of("Line", name, node=node)
        yield must(f"network, line: {label}, node {node}, N", value, target, max(0.05, 0.02 * target * (node == 3)))


def consensus() -> Iterator[Row]:
    """Yield the errors of the filter with a consensus over its exchanges."""
    spreads = {}
    for gamma, exchanges, targets in (
        (0.1, 1, (12.07, 12.67, 21.94)),
        (0.1, 5, (12.55, 12.98, 14.81)),
        (0.1, 20, (13.16, 13.28, 13.44)),
        (0.3, 1, (12.43, 13.03, 15.18)),
        (0.3, 5, (13.10, 13.26, 13.49)),
        (0.3, 20, (13.35, 13.35, 13.35)),
    ):
        arguments = {"gamma": gamma, "exchanges": exchanges}
        values = [error_of("Line", "kalman_consensus", node=node, **arguments) for node in NODES]
        spreads[gamma, exchanges] = max(values) - min(values)
        for node, value, target in zip(NODES, values, targets, strict=True):
            yield must(
                f"network, line: DKFCF gamma {gamma}, S {exchanges}, node {node}, N", value, target, 0.01 * target
            )
        both = error_of("", "kalman_consensus", **arguments)
        yield must(f"network, full: DKFCF gamma {gamma}, S {exchanges}, N", both, 12.016, 0.05)
    for gamma in (0.1, 0.3):
        falls = spreads[gamma, 1] > spreads[gamma, 5] > spreads[gamma, 20]
        yield ranking(f"network, line: the spread of DKFCF falls with S, gamma {gamma}", falls)


def weighted() -> Iterator[Row]:
    """Yield what weighted averaging gains, and the deviations that it claims."""
    errors = (
        error_of("", "kalman_central"),
        error_of("Line", "kalman_weighted", node=3),
        error_of("Line", "kalman_distributed", node=3),
    )
    yield ranking("network, line: DKFWA node 3 between CKF and DIF", errors[0] < errors[1] < errors[2])
    for node, target in zip(NODES, (3.47, 3.47, 4.70), strict=True):
        claim = estimate(network("Line"), readings()[0][0], "kalman_weighted", q_N2_per_s=1e5, node=node)
        yield must(
            f"network, line: DKFWA node {node}, claimed standard deviation, N", deviation_of(claim), target, 0.01
        )


def not_reproducible() -> Iterator[Row]:
    """Figures of the thesis without values."""
    for item, reason in (
        ("spindle: FEM model and its frequency responses, figures 3-1 to 3-4", "no data; only the modes of table 1"),
        ("spindle and drive: covariances Q and R", "tuned by hand and not printed"),
        ("drive: inertia, torque constant, gains and sampling time of chapter 4", "not printed; values are ours"),
    ):
        yield Row(
            paper=PAPER,
            item=item,
            paper_value=None,
            value=float("nan"),
            target=float("nan"),
            tolerance=0.0,
            kind="not reproducible",
            reason=reason,
        )


def parts() -> Parts:
    """Return the parts of the thesis' recomputation whose figures stand beside ours."""
    return {
        "spindle, plant": spindle_plant,
        "spindle, continuous filter": continuous_filter,
        "spindle, steps": spindle_steps,
        "milling": milling,
        "drive, current": drive_current,
        "network, central and alone": alone,
        "network, full: DIF, gain form": partial(linked, "DIF, gain form", "kalman_distributed"),
        "network, full: DIF, information form": partial(
            linked, "DIF, information form", "kalman_distributed", form="information"
        ),
        "network, full: PIF, exact": partial(linked, "PIF, exact", "kalman_parallel"),
        "network, full: DKFCF": partial(linked, "DKFCF", "kalman_consensus"),
        "network, full: DKFWA": partial(linked, "DKFWA", "kalman_weighted"),
        "network, full: PIF as printed": printed_parallel,
        "network, line: DIF": partial(in_line, "DIF", "kalman_distributed", (12.016, 12.016, 35.13)),
        "network, line: DKFWA": partial(in_line, "DKFWA", "kalman_weighted", (12.016, 12.016, 15.42)),
        "network, line: DKFCF": consensus,
        "network, line: DKFWA beside the others": weighted,
        "not reproducible": not_reproducible,
    }
