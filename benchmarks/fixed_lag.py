"""What a lag buys: the force of `rts_smoother` given readings up to so many samples after each.

    python benchmarks/fixed_lag.py [--first-seed 200] [--seeds 5]

A smoother of fixed lag L holds the adjoint of L samples more than a row: with the transition T of the smoother's
backward pass, r_k - T^(L + 1) r_(k + L + 1) in place of r_k. Lag 0 is the filter of the same model. Densities are those
that the smoother finds in the whole record.
"""

import argparse
from unittest import mock

import numpy as np
from fdbench_baselines import rts_smoother
from fdbench_baselines._kalman_filter import Observer, gain, steady_covariance
from fdbench_baselines._steady_smoother import SteadyFiltered, filtered

from fdbench.estimator import Estimate, FloatArray
from fdbench.metrics import Outcome, metrics
from fdbench.scenario import load_scenario

SCENARIOS = ("SensorNetwork-v1", "SpindleMilling-v1", "SpindleStep-v1")
LAGS = (0, 1, 2, 5)


def transition(model: Observer) -> FloatArray:
    """Return what takes an adjoint one sample back, in the units of `SteadyFiltered`."""
    P = steady_covariance(model)
    size, noise = np.sqrt(np.diag(P)), np.sqrt(model.R)
    A, C = model.A / size[:, None] * size, model.C / noise[:, None] * size
    K = gain(P / np.outer(size, size), C, np.ones(len(C)))
    return np.asarray((A @ (np.eye(len(P)) - K @ C)).T)


def lagged(run: SteadyFiltered, back: FloatArray, lag: int) -> FloatArray:
    """Return the force at each row, given readings up to ``lag`` samples after it; N."""
    later = np.zeros_like(run.adjoints)
    later[: -lag - 1] = run.adjoints[lag + 1 :]
    known = run.adjoints - later @ np.linalg.matrix_power(back, lag + 1).T
    return np.asarray(
        (run.states[:, rts_smoother.FORCE] + known @ run.P[:, rts_smoother.FORCE]) * run.size[rts_smoother.FORCE]
    )


def errors(scenario_id: str, seed: int) -> list[float]:
    """Return the error of the force over its size, in per cent, for each lag and for the whole record."""
    scenario = load_scenario(scenario_id)
    record, truth = scenario.observe(seed)
    runs: list[tuple[Observer, SteadyFiltered]] = []

    def remembered(model: Observer, u: FloatArray, y: FloatArray) -> SteadyFiltered:
        runs.append((model, filtered(model, u, y)))
        return runs[-1][1]

    with mock.patch.object(rts_smoother, "filtered", remembered):  # the last one is that of the densities found
        whole = rts_smoother.RtsSmoother().fit(scenario.context(), record).disturbance_N
    model, run = runs[-1]
    back = transition(model)
    claims = [lagged(run, back, lag) for lag in LAGS]
    for force in claims:
        force[1:] = 0.5 * (force[1:] + force[:-1])
    regression, score = scenario.context().regression(record), metrics.get("disturbance_error")().score
    return [
        score(
            Outcome(
                scenario=scenario,
                record=record,
                regression=regression,
                truth=truth,
                estimate=Estimate(disturbance_N=force),
                seconds=0.0,
            )
        )
        for force in (*claims, whole)
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first-seed", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    print(f"| lag, samples | {' | '.join(map(str, LAGS))} | the whole record |\n| --- |{' --- |' * (len(LAGS) + 1)}")
    for name in SCENARIOS:
        runs = [errors(name, seed) for seed in range(given.first_seed, given.first_seed + given.seeds)]
        print(f"| `{name}` | {' | '.join(f'{value:.1f}' for value in np.mean(runs, axis=0))} |", flush=True)


if __name__ == "__main__":
    main()
