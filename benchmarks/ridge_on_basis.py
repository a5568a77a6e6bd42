"""What an L2 penalty does for regression on spectra: LR and LR-NFB of Qu and Vogl with ridge, by case.

    python benchmarks/ridge_on_basis.py [--first-seed 200] [--seeds 3]

Columns in units of their deviation, the constant free; one penalty for all lines, by generalised cross-validation
(Golub, Heath and Wahba, Technometrics 21 (1979), 215-223) or, which nobody could know, the best of those tried.
"""

import argparse
from collections.abc import Callable

import numpy as np
from fdbench_baselines._function_basis import LINEAR, NONLINEAR, estimate_force
from fdbench_baselines._sparse_regression import least_squares

from fdbench.estimator import FloatArray
from fdbench.scenario import load_scenario
from fdbench.statistics import rms

CASES = ("SpindleTestbedRandom-v1", "SpindleTestbedForce-v1", "SpindleTestbedSpeed-v1")
PENALTIES = tuple(10.0**power for power in range(-10, 3))  # of the largest squared singular value


def ridge(share: float | None) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return what solves with a penalty, or with that of cross-validation."""

    def solve(G: FloatArray, Y: FloatArray) -> FloatArray:
        mean, offset = G[:, 1:].mean(axis=0), Y.mean(axis=0)
        size = G[:, 1:].std(axis=0)
        U, s, Vt = np.linalg.svd((G[:, 1:] - mean) / size, full_matrices=False)
        told = U.T @ (Y - offset)
        beside = float(np.sum((Y - offset) ** 2) - np.sum(told**2))

        def lost(penalty: float) -> float:
            left = penalty / (s**2 + penalty)
            return (beside + float(np.sum((left[:, None] * told) ** 2))) / (len(Y) - 1 - np.sum(1.0 - left)) ** 2

        penalty = s[0] ** 2 * (min(PENALTIES, key=lambda one: lost(s[0] ** 2 * one)) if share is None else share)
        weights = (Vt.T @ ((s / (s**2 + penalty))[:, None] * told)) / size[:, None]
        return np.vstack((offset - mean @ weights, weights))

    return solve


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--first-seed", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    print("| case | functions | least squares | ridge, cross-validated | ridge, the best of all tried |")
    print("| --- | --- | --- | --- | --- |")
    for case in CASES:
        scenario = load_scenario(case)
        for label, functions in (("LR", LINEAR), ("LR-NFB", NONLINEAR)):
            found = []
            for seed in range(given.first_seed, given.first_seed + given.seeds):
                record, truth = scenario.observe(seed)
                if truth.disturbance_N is None:
                    raise ValueError(f"{case}: the true force is not known.")
                wanted = truth.disturbance_N[record["training_sample"] == 0]
                solvers = [least_squares, ridge(None), *map(ridge, PENALTIES)]
                forces = [estimate_force(scenario.context(), record, functions, one).disturbance_N for one in solvers]
                found.append([100.0 * rms(force - wanted) / rms(wanted) for force in forces if force is not None])
            plain, validated, *tried = np.mean(found, axis=0)
            print(f"| `{case}` | {label} | {plain:.0f} | {validated:.0f} | {min(tried):.0f} |", flush=True)


if __name__ == "__main__":
    main()
