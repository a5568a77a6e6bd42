"""CPU time of one step of the Kalman filter, with its covariance in the form of Joseph and with a steady gain.

The twin is the textbook recursion in plain NumPy. Bursts of all take turns, on one thread; the best counts.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from time import process_time

import numpy as np
from fdbench_baselines import _kalman_filter as kf

STATES = (3, 7, 9)
BURSTS, SAMPLES = 30, 2000


def model_of(n: int, rng: np.random.Generator) -> kf.Observer:
    A = rng.standard_normal((n, n))
    A *= 0.98 / np.abs(np.linalg.eigvals(A)).max()
    root = rng.standard_normal((n, n))
    return kf.Observer(
        A, rng.standard_normal((n, 1)), rng.standard_normal((1, n)), root @ root.T, np.ones(1), np.eye(n)
    )


def textbook(model: kf.Observer, u: kf.FloatArray, y: kf.FloatArray) -> kf.FloatArray:
    x, P, eye, forces = np.zeros(len(model.A)), model.P, np.eye(len(model.A)), np.empty(len(y))
    for k in range(len(y)):
        x, P = model.A @ x + model.B @ u[k], model.A @ P @ model.A.T + model.Q
        S = model.C @ P @ model.C.T + model.R
        K = P @ model.C.T / S
        x = x + K @ (y[k] - model.C @ x)
        rest = eye - K @ model.C
        P = rest @ P @ rest.T + K * model.R @ K.T
        forces[k] = x[-1]
    return forces


def main() -> None:
    rng = np.random.default_rng(0)
    print("states  Joseph us/step  steady us/step  NumPy us/step  ratio  largest difference")
    for n in STATES:
        model = model_of(n, rng)
        constant = kf.steady_filter(model)
        u, y = rng.standard_normal((SAMPLES, 1)), rng.standard_normal((SAMPLES, 1))
        short_u, short_y = u[: SAMPLES // 20], y[: SAMPLES // 20]
        times: dict[str, list[float]] = {"Joseph": [], "steady": [], "NumPy": []}
        for burst in range(BURSTS + 1):
            t0 = process_time()
            out, _ = kf.filter_readings(model, np.zeros(n), model.P.copy(), u, y)
            t1 = process_time()
            kf.run_constant_filter(constant, np.zeros(n), u, y)
            t2 = process_time()
            expected = textbook(model, short_u, short_y)
            t3 = process_time()
            if burst > 0:  # the first one compiles
                times["Joseph"].append((t1 - t0) / len(y))
                times["steady"].append((t2 - t1) / len(y))
                times["NumPy"].append((t3 - t2) / len(short_y))
        worst = float(np.abs(out[: len(expected), kf.FORCE] - expected).max())
        joseph, steady, plain = (1e6 * min(values) for values in times.values())
        print(f"{n:6d} {joseph:15.3f} {steady:15.3f} {plain:14.1f} {plain / joseph:6.0f} {worst:19.1e}")


if __name__ == "__main__":
    main()
