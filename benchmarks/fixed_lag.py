"""What a lag buys: the force of `fixed_lag_smoother` given readings up to so many samples after each row.

    python benchmarks/fixed_lag.py [--first-seed 200] [--seeds 5]

Beside it that of the smoother of the same model, `rts_smoother` in state space and `rts_friction` on a drive. Variances
are those that the whole record tells.
"""

import argparse

import numpy as np
from fdbench_baselines.fixed_lag_smoother import FixedLagSmoother
from fdbench_baselines.rts_friction import RtsFriction
from fdbench_baselines.rts_smoother import RtsSmoother

from fdbench.estimator import BatchEstimator
from fdbench.metrics import Outcome, metrics
from fdbench.scenario import load_scenario

SCENARIOS = {
    "SensorNetwork-v1": RtsSmoother,
    "SpindleMilling-v1": RtsSmoother,
    "SpindleStep-v1": RtsSmoother,
    "ShakerConstant-v2": RtsFriction,
    "MillingIncreasing-v2": RtsFriction,
    "LinearMotorAxis-v1": RtsFriction,
    "BallScrewAxis-v2": RtsFriction,
}
LAGS = (0, 1, 2, 5, 20, 100)


def errors(scenario_id: str, seed: int) -> list[float]:
    """Return the error of the force over its size, in per cent, for each lag and for the whole record."""
    scenario = load_scenario(scenario_id)
    record, truth = scenario.observe(seed)
    context = scenario.context()
    regression, score = context.regression(record), metrics.get("disturbance_error")().score
    rows: list[BatchEstimator] = [*(FixedLagSmoother(lag=lag) for lag in LAGS), SCENARIOS[scenario_id]()]
    return [
        score(
            Outcome(
                scenario=scenario,
                record=record,
                regression=regression,
                truth=truth,
                estimate=row.fit(context, record),
                seconds=0.0,
            )
        )
        for row in rows
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first-seed", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    print(f"| lag, samples | {' | '.join(map(str, LAGS))} | the smoother |\n| --- |{' --- |' * (len(LAGS) + 1)}")
    for name in SCENARIOS:
        runs = [errors(name, seed) for seed in range(given.first_seed, given.first_seed + given.seeds)]
        print(f"| `{name}` | {' | '.join(f'{value:.1f}' for value in np.mean(runs, axis=0))} |", flush=True)


if __name__ == "__main__":
    main()
