"""Chou, Duan, Okwudire: a linear hybrid model that learns what a physics model of the servo lacks."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.estimator import estimators
from fdbench.motions.circular_spiral import CircularSpiral
from fdbench.motions.jerk_limited_moves import JerkLimitedMoves, move_time
from fdbench.plants._servo_stage import StagePlant
from fdbench.reproduce._row import Parts, Row
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.stage import Response
from fdbench.simulate.system import Noise
from fdbench.statistics import rms

PAPER = "Chou, Duan, Okwudire"
SEEDS = 5
UM_PER_M = 1e6
START_UP = 0.05  # share of the record that the paper leaves to the physics model
OTHER_DWELL = "the paper gives neither dwell nor regularisation: ours are a move a second and 1 mm^2"
OWN_SPIRAL = "measured on a stage; path, unmodelled effects and noise are ours"

FloatArray = NDArray[np.float64]


def rms_um(values: FloatArray) -> float:
    """Return the root mean square of values in m, in um."""
    return UM_PER_M * rms(values)


def moves_of(scenario: Scenario) -> tuple[JerkLimitedMoves, tuple[float, float, float]]:
    """Return the motion of a staircase, and its velocity, acceleration and jerk."""
    motion = scenario.motion
    if not isinstance(motion, JerkLimitedMoves):
        raise TypeError(f"{scenario.id}: the motion is no series of moves.")
    return motion, (motion.velocity_m_per_s, motion.acceleration_m_per_s2, motion.jerk_m_per_s3)


def changed(scenario: Scenario, effects: tuple[Effect, ...] | None = None, noisy: bool = True) -> Scenario:
    """Return a scenario with other effects or without noise."""
    reality = scenario.reality
    kept = reality.effects if effects is None else effects
    noise = reality.noise if noisy else Noise()
    return dataclasses.replace(scenario, reality=dataclasses.replace(reality, effects=kept, noise=noise))


def dwelling(scenario: Scenario, dwell_s: float, initial_dwell_s: float = 0.0) -> Scenario:
    """Return a staircase with other dwells, as long as its moves then take."""
    motion, limits = moves_of(scenario)
    lengths = np.abs(np.diff(motion.stops_m)).tolist()
    duration = initial_dwell_s + sum(move_time(length, *limits) + dwell_s for length in lengths)
    return dataclasses.replace(
        scenario,
        motion=dataclasses.replace(motion, dwell_s=dwell_s, initial_dwell_s=initial_dwell_s),
        timing=dataclasses.replace(scenario.setup.timing, duration_s=duration),
    )


def errors(scenario: Scenario, name: str, seed: int = 0, **arguments: Any) -> FloatArray:
    """Return the prediction errors of an estimator (n_axes, n_samples), m."""
    record, _ = scenario.observe(seed)
    context = scenario.context()
    target = context.regression(record).target
    output = estimators.get(name)(**arguments).fit(context, record).output
    if output is None:
        raise TypeError(f"{name} predicts no output.")
    return (target - output).reshape(-1, record.n_samples)


def later_um(error: FloatArray) -> float:
    """Return the root mean square error after the start-up, um."""
    return rms_um(error[..., round(START_UP * error.shape[-1]) :])


def hybrid_um(scenario: Scenario, seeds: int = SEEDS, lam_mm2: float = 1.0, **arguments: Any) -> float:
    """Return the hybrid model's error after the start-up, mean over seeds, um; weights as published."""
    settings = {"regularisation_m2": 1e-6 * lam_mm2, **arguments}
    return float(np.mean([later_um(errors(scenario, "hybrid_rls", seed, **settings)) for seed in range(seeds)]))


def physics_um(scenario: Scenario, seeds: int = SEEDS) -> float:
    """Return the physics model's error after the start-up, mean over seeds, um."""
    return float(np.mean([later_um(errors(scenario, "physics_model", seed)) for seed in range(seeds)]))


def must(item: str, paper: float | None, value: float, target: float, tolerance: float, reason: str = "") -> Row:
    """Return a row that has to hold."""
    return Row(
        paper=PAPER,
        item=item,
        paper_value=paper,
        value=value,
        target=target,
        tolerance=tolerance,
        kind="must",
        reason=reason,
    )


def ranking(item: str, holds: bool, reason: str = "") -> Row:
    """Return a row for an order that has to hold."""
    return Row(
        paper=PAPER,
        item=item,
        paper_value=None,
        value=float(holds),
        target=1.0,
        tolerance=0.0,
        kind="ranking",
        reason=reason,
    )


def measured(item: str, paper: float, value: float, reason: str) -> Row:
    """Return a row beside a figure that cannot be reproduced."""
    return Row(
        paper=PAPER,
        item=item,
        paper_value=paper,
        value=value,
        target=paper,
        tolerance=0.0,
        kind="not reproducible",
        reason=reason,
    )


def staircase_rows(scenario: Scenario) -> list[Row]:
    """Return the rows of the physics model on the staircase (section 3.2)."""
    _, limits = moves_of(scenario)
    true = errors(changed(scenario, noisy=False), "physics_model")
    drag, stiffness = scenario.reality.effects
    rows = [
        must("time of a 10 mm move, s", None, move_time(0.01, *limits), 0.143, 1e-9),
        must("RMS e_pb, true position, um", 33.7, rms_um(true), 33.58, 0.005 * 33.58, OTHER_DWELL),
        must("largest |e_pb|, um", None, UM_PER_M * float(np.abs(true).max()), 166.3, 1.663),
        must("RMS e_pb after 5 %, true position, um", None, later_um(true), 32.29, 0.005 * 32.29),
        must("RMS e_pb after 5 %, noisy, um", 33.7, physics_um(scenario), 32.77, 0.005 * 32.77, OTHER_DWELL),
    ]
    for item, effect, target in (("x^2", stiffness, 17.56), ("x'^2", drag, 28.59)):
        value = rms_um(errors(changed(scenario, effects=(effect,), noisy=False), "physics_model"))
        rows.append(must(f"RMS e_pb with the {item} term only, um", None, value, target, 0.005 * target))
    dwells = {0.2: 53.8, 0.3: 45.8, 0.5: 39.6, 0.757: 34.9, 0.8: 34.3, 0.85: 33.67, 1.0: 32.0}
    for dwell, target in dwells.items():
        value = rms_um(errors(changed(dwelling(scenario, dwell), noisy=False), "physics_model"))
        rows.append(must(f"RMS e_pb with a dwell of {dwell:g} s, um", None, value, target, 0.005 * target))
    return rows


def hybrid_rows(scenario: Scenario) -> list[Row]:
    """Return the rows of the hybrid model on the staircase, with its sweeps."""
    hybrid, physics = hybrid_um(scenario), physics_um(scenario)
    rows = [
        must("RMS hybrid, um", 14.7, hybrid, 14.54, 0.5, OTHER_DWELL),
        must("improvement, %", 56.4, 100.0 * (1.0 - hybrid / physics), 55.6, 1.6, OTHER_DWELL),
    ]
    sweep: dict[str, dict[float, float]] = {
        "lam_mm2": {1e-6: 9.30, 0.01: 10.6, 0.1: 11.7, 0.3: 12.7, 3: 16.7, 10: 19.4, 100: 25.3},
        "error_lags": {0: 26.5, 10: 21.6, 25: 16.8, 50: 14.7, 75: 14.3, 100: 14.4},
        "response_lags": {0: 22.0, 10: 10.6},
        "batch_samples": {20: 8.9, 50: 10.7, 200: 18.7},
    }
    symbols = {"lam_mm2": "lam", "error_lags": "p", "response_lags": "q", "batch_samples": "Np"}
    found: dict[str, list[float]] = {}
    for argument, targets in sweep.items():
        for value, target in targets.items():
            settings: dict[str, Any] = {argument: value}
            result = hybrid_um(scenario, **settings)
            found.setdefault(argument, []).append(result)
            rows.append(must(f"RMS hybrid with {symbols[argument]} = {value:g}, um", None, result, target, 0.5))
    over_lam = [*found["lam_mm2"][1:3], hybrid, *found["lam_mm2"][5:]]
    rows.append(ranking("hybrid falls behind as lam rises from 0.01 to 100", bool(np.all(np.diff(over_lam) > 0.0))))
    return rows


def start_up_rows(scenario: Scenario) -> list[Row]:
    """Return the rows that show how much rests on what the model has seen when it starts."""
    late = dwelling(scenario, 0.857, initial_dwell_s=0.857)
    physics = physics_um(late)
    rows = [must("initial dwell: RMS e_pb after 5 %, um", None, physics, 32.6, 0.005 * 32.6)]
    reason = "after 5 % no move has been seen yet: 'never less accurate' rests on the initialisation period"
    for lam in (0.1, 1.0):
        hybrid = hybrid_um(late, lam_mm2=lam)
        rows.append(must(f"initial dwell: RMS hybrid with lam = {lam:g}, um", None, hybrid, 34.5, 1.5))
        rows.append(ranking(f"initial dwell: hybrid worse than physics with lam = {lam:g}", hybrid > physics, reason))
    other = dwelling(scenario, 0.7, initial_dwell_s=0.7)
    reason = "a second reading of the paper: 0.7 s before and after each move, lam = 0.1"
    true = rms_um(errors(changed(other, noisy=False), "physics_model"))
    rows.append(must("second reading: RMS e_pb, um", 33.7, true, 33.50, 0.005 * 33.5, reason))
    rows.append(must("second reading: RMS hybrid, um", 14.7, hybrid_um(other, lam_mm2=0.1), 14.56, 0.5, reason))
    return rows


def gain_at(response: Response, omega: float) -> complex:
    """Return the frequency response at omega, rad/s."""
    return complex(response.C @ np.linalg.solve(1j * omega * np.eye(len(response.B)) - response.A, response.B))


def right_zero(response: Response) -> float:
    """Return the zero in the right half-plane, rad/s."""
    from scipy.linalg import eig

    n = len(response.B)
    system = np.block([[response.A, response.B[:, None]], [response.C[None], np.zeros((1, 1))]])
    zeros = eig(system, np.diag([1.0] * n + [0.0]), right=False)
    return float(zeros[np.isfinite(zeros)].real.max())


def stage_rows(stage: StagePlant) -> list[Row]:
    """Return the rows of the identified transfer functions (table 1)."""
    targets = {
        "x_": (1.000049, -661.8, 230.9, -1.13, 64.0, 42.5),
        "y_": (1.000285, -772.9, 151.1, -1.04, 48.0, 25.7),
    }
    rows = []
    for prefix, response in stage.axes().items():
        axis = prefix[0].upper()
        dc, beta, zero, delay, peak, place = targets[prefix]
        static = float(response.C @ response.rest)
        slope = -float(response.C @ np.linalg.solve(response.A, -response.rest))
        frequencies = np.arange(10.0, 60.0, 0.01)
        sizes = [abs(gain_at(response, 2.0 * math.pi * frequency)) for frequency in frequencies]
        rows += [
            must(f"{axis}: static gain", None, static, dc, 1e-6),
            must(f"{axis}: sum of beta, 1/s", None, float(response.C @ response.B), beta, 0.05),
            must(f"{axis}: zero in the right half-plane, rad/s", None, right_zero(response), zero, 0.05),
            must(f"{axis}: group delay at 0 Hz, ms", None, -1e3 * slope / static, delay, 0.005),
            must(f"{axis}: largest |G|", None, max(sizes), peak, 0.5),
            must(f"{axis}: frequency of the largest |G|, Hz", None, frequencies[int(np.argmax(sizes))], place, 0.1),
        ]
    return rows


def spiral_rows(scenario: Scenario) -> list[Row]:
    """Return the rows of both models on the spiral (section 4.2)."""
    motion = scenario.motion
    if not isinstance(motion, CircularSpiral):
        raise TypeError(f"{scenario.id}: the motion is no spiral.")
    limits = motion.velocity_m_per_s, motion.acceleration_m_per_s2, motion.jerk_m_per_s3
    duration = move_time(float(motion.arc_length(np.asarray(motion.end_angle_rad))), *limits)
    period = scenario.setup.timing.sampling_time_s
    reference = motion.reference(period, scenario.setup.timing.n_samples)
    second = [np.gradient(np.gradient(reference[:, column], period), period) for column in (0, 3)]
    rows = [
        must("spiral: whole samples", None, math.floor(duration / period) + 1, 4057.0, 0.0),
        must("spiral: largest acceleration by differences, m/s^2", None, float(np.hypot(*second).max()), 8.53, 0.01),
    ]
    silent = errors(changed(scenario, noisy=False), "physics_model")
    for axis, paper, error in zip("XY", (22.0, 130.2), silent, strict=True):
        rows.append(must(f"spiral {axis}: RMS e_pb, um", paper, rms_um(error), paper, 0.01 * paper, OWN_SPIRAL))
    physics = errors(scenario, "physics_model")
    targets = {0.01: (38.6, 39.3), 1.0: (40.1, 37.0), 10.0: (35.3, 32.3)}
    for lam, improvements in targets.items():
        hybrid = errors(scenario, "hybrid_rls", regularisation_m2=1e-6 * lam)
        for axis, paper, figure, place in zip("XY", (38.0, 27.0), (13.7, 94.5), (0, 1), strict=True):
            gain = 100.0 * (1.0 - later_um(hybrid[place]) / later_um(physics[place]))
            item = f"spiral {axis}: improvement with lam = {lam:g}, %"
            rows.append(must(item, paper, gain, improvements[place], 4.0, OWN_SPIRAL))
            if lam == 1.0:
                rows.append(measured(f"spiral {axis}: RMS hybrid, um", figure, later_um(hybrid[place]), OWN_SPIRAL))
    gains = []
    for kept in (scenario.reality.effects[1:], scenario.reality.effects, scenario.reality.effects[:1]):
        part = changed(scenario, effects=kept)
        after = [later_um(errors(part, name)) for name in ("hybrid_rls", "physics_model")]
        gains.append(1.0 - after[0] / after[1])
    smooth, both, friction = gains
    rows.append(ranking("spiral: the smoother the nonlinearity, the larger the gain", smooth > both > friction))
    return rows


def stage_of(scenario: Scenario) -> StagePlant:
    """Return the plant of a scenario, which has to be a servo stage."""
    if not isinstance(scenario.plant, StagePlant):
        raise TypeError(f"{scenario.id}: no servo stage.")
    return scenario.plant


def parts() -> Parts:
    """Return the parts of the paper whose figures stand beside ours."""
    staircase, spiral = "ServoStaircase-v0", "ServoSpiral-v0"
    return {
        "staircase": lambda: staircase_rows(load_scenario(staircase)),
        "staircase, hybrid": lambda: hybrid_rows(load_scenario(staircase)),
        "staircase, start": lambda: start_up_rows(load_scenario(staircase)),
        "stage": lambda: stage_rows(stage_of(load_scenario(spiral))),
        "spiral": lambda: spiral_rows(load_scenario(spiral)),
    }
