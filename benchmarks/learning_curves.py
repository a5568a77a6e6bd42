"""How fast online estimators learn: errors after so many seconds of a record, mean over seeds.

    python benchmarks/learning_curves.py [--first-seed 200] [--seeds 5]

Parameters are those of the record so far: an estimator is given what was logged up to then and nothing else. Force and
output are claimed row by row before the rows to come, and their error is that of a stretch of the record. The weights
of `parameter_error` are those of the whole record throughout, so that columns of a line compare.
"""

import argparse
import itertools

import numpy as np

from fdbench.estimator import Context, FloatArray, estimators
from fdbench.metrics import metrics
from fdbench.record import Record
from fdbench.scenario import load_scenario
from fdbench.statistics import rms

Curves = tuple[tuple[str, tuple[float, ...], tuple[str, ...]], ...]

PARAMETERS: Curves = (
    (
        "ShakerConstant-v2",
        (1.0, 2.0, 3.0, 6.0, 12.0),
        ("null", "joint_kalman", "krls_t", "hybrid_rls", "kalman", "ukf_lugre"),
    ),
    (
        "MillingUpDown-v2",
        (1.0, 2.0, 4.0, 9.0, 18.0),
        ("null", "joint_kalman", "krls_t", "hybrid_rls", "kalman", "ukf_lugre"),
    ),
    ("SlotMillingRunout200Rpm50N-v2", (3.0, 3.3, 3.6, 4.0, 5.1), ("null", "sliding_dft_least_squares")),
)
FORCES: Curves = (
    (
        "ShakerConstant-v2",
        (2.0, 2.25, 2.5, 3.0, 4.0, 6.0, 10.0),
        ("joint_kalman", "krls_t", "hybrid_rls", "frequency_locked_loop", "extended_state_observer"),
    ),
)
OUTPUTS: Curves = (
    ("ServoStaircase-v1", (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 6.0), ("hybrid_rls", "hybrid_regions", "physics_model")),
)


def parameter_errors(name: str, scenario_id: str, times_s: tuple[float, ...], seed: int) -> list[float]:
    """Return the error of the parameters, in per cent, so long after the first row of the regression."""
    scenario = load_scenario(scenario_id)
    (record, truth), context = scenario.observe(seed), scenario.context()
    regression = context.regression(record)
    weights = np.mean(regression.regressors**2, axis=0)
    true = np.array([truth.parameters[key] for key in context.nominal])

    def error(values: FloatArray) -> float:
        return float(100.0 * np.sqrt(weights @ (values - true) ** 2 / (weights @ true**2)))

    first_s = float(regression.time_s[0])
    return [error(found_by(name, context, record, first_s + time_s)) for time_s in times_s]


def found_by(name: str, context: Context, record: Record, until_s: float) -> FloatArray:
    """Return the parameters that an estimator has by a time of the record's clock."""
    stop = int(np.searchsorted(record["time_s"], until_s + 1e-9))
    estimate = estimators.get(name)().fit(context, record.slice(0, min(stop, record.n_samples)))
    return np.array([estimate.parameters[key] for key in context.nominal])


def stretch_errors(name: str, scenario_id: str, edges_s: tuple[float, ...], seed: int, is_force: bool) -> list[float]:
    """Return the error between each two edges, in per cent: of the force over its own size, or of the output in um."""
    scenario = load_scenario(scenario_id)
    (record, truth), context = scenario.observe(seed), scenario.context()
    regression = context.regression(record)
    estimate = estimators.get(name)().fit(context, record)
    time_s = regression.time_s - record["time_s"][0]
    claimed = estimate.disturbance_N if is_force else estimate.output
    wanted = truth.disturbance_N[regression.rows] if is_force and truth.disturbance_N is not None else regression.target
    if claimed is None:
        raise ValueError(f"{name} claims nothing of {scenario_id} here.")
    error = claimed - wanted
    found = []
    for low, high in itertools.pairwise(edges_s):
        inside = (time_s >= low) & (time_s < high)
        if is_force:
            found.append(
                100.0 * rms(error[inside] - error[inside].mean()) / rms(wanted[inside] - wanted[inside].mean())
            )
        else:
            found.append(1e6 * rms(error[inside]))
    return found


def line(name: str, runs: list[list[float]]) -> str:
    """Return a line of the table: the mean over the seeds."""
    return f"| `{name}` | {' | '.join(f'{value:.3g}' for value in np.mean(runs, axis=0))} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first-seed", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    for scenario, times_s, names in PARAMETERS:
        print(f"\n{scenario}: {metrics.summary('parameter_error')} In per cent, after so many seconds")
        print(f"| | {' | '.join(f'{time_s:g} s' for time_s in times_s)} |\n| --- |{' --- |' * len(times_s)}")
        for name in names:
            print(line(name, [parameter_errors(name, scenario, times_s, seed) for seed in seeds]), flush=True)
    for kinds, is_force in ((FORCES, True), (OUTPUTS, False)):
        for scenario, edges_s, names in kinds:
            print(
                f"\n{scenario}: error of the {'force, per cent' if is_force else 'predicted position, um'}, by stretch"
            )
            spans = " | ".join(f"{low:g} to {high:g} s" for low, high in itertools.pairwise(edges_s))
            print(f"| | {spans} |\n| --- |{' --- |' * (len(edges_s) - 1)}")
            for name in names:
                runs = [stretch_errors(name, scenario, edges_s, seed, is_force) for seed in seeds]
                print(line(name, runs), flush=True)


if __name__ == "__main__":
    main()
