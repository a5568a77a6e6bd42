"""A sample of recursive least squares with 55 regressors, beside padasip, filterpy and river, and of the hybrid model.

All take in one stream of samples; what is compared is the error of each prediction before its sample is taken in. The
hybrid model has no peer but its recursion in plain NumPy; on the staircase of its paper it is compared with real time.
"""

from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import count

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._recursive_least_squares import FloatArray, predict, rls, untrained
from fdbench_baselines.hybrid_rls import HybridRLS

from fdbench.scenario import load_scenario

LAGS, ERRORS, BATCH = 3, 50, 100
N = 2 + LAGS + ERRORS
ROUNDS, SAMPLES = 30, 300
LAM, DELTA = 0.999, 1e4

RANDOM = np.random.default_rng(0)
X, Y = RANDOM.standard_normal(((ROUNDS + 1) * SAMPLES, N)), RANDOM.standard_normal((ROUNDS + 1) * SAMPLES)


def stream(take: Callable[[slice], FloatArray]) -> Burst:
    """Return a burst that takes the next samples each time."""
    parts = (slice(start, start + SAMPLES) for start in count(step=SAMPLES))
    return lambda: take(next(parts))


def one_by_one(take: Callable[[FloatArray, float], float]) -> Burst:
    return stream(lambda part: np.array([take(x, y) for x, y in zip(X[part], Y[part], strict=True)]))


def ours(lam: float, delta: float) -> Burst:
    theta, P = np.zeros(N), delta * np.eye(N)
    return stream(lambda part: rls(theta, P, X[part], Y[part], lam))


def numpy_loop() -> Burst:
    theta: FloatArray = np.zeros(N)
    P: FloatArray = DELTA * np.eye(N)

    def take(x: FloatArray, y: float) -> float:
        nonlocal theta, P
        g = P @ x
        power, error = LAM + x @ g, y - x @ theta
        theta = theta + g * (error / power)
        g /= np.sqrt(power)  # an outer product of one vector is symmetric to the last bit, as P has to stay
        P -= np.outer(g, g)
        P /= LAM
        return float(error)

    return one_by_one(take)


def padasip() -> Burst:
    peer = import_module("padasip").filters.FilterRLS(N, mu=LAM, eps=1.0 / DELTA, w="zeros")

    def take(x: FloatArray, y: float) -> float:
        error = y - peer.predict(x)
        peer.adapt(y, x)
        return float(error)

    return one_by_one(take)


def filterpy() -> Burst:
    """Return the burst of a Kalman filter of constant states; its fading memory is the forgetting."""
    peer = import_module("filterpy.kalman").KalmanFilter(dim_x=N, dim_z=1)
    peer.F, peer.Q, peer.P, peer.alpha = np.eye(N), np.zeros((N, N)), DELTA * np.eye(N), LAM**-0.5

    def take(x: FloatArray, y: float) -> float:
        peer.predict()
        peer.update(y, H=x[None])
        return float(peer.y[0, 0])

    return one_by_one(take)


def river() -> Burst:
    """Return the burst of a regression without forgetting on features by name, made beforehand."""
    peer = import_module("river.linear_model").BayesianLinearRegression(alpha=1.0, beta=1.0)
    named = [dict(enumerate(row)) for row in X.tolist()]

    def take(part: slice) -> FloatArray:
        errors = []
        for x, y in zip(named[part], Y[part], strict=True):
            errors.append(y - peer.predict_one(x))
            peer.learn_one(x, y)
        return np.array(errors)

    return stream(take)


RESPONSE = np.cumsum(RANDOM.standard_normal(len(Y))) * 0.01
ERROR = np.convolve(RANDOM.standard_normal(len(Y)), np.exp(-0.05 * np.arange(100)), "same") * 0.01


def hybrid() -> Burst:
    state = untrained(LAGS, ERRORS, 1.0)
    return stream(lambda part: predict(state, RESPONSE[part], ERROR[part], LAGS, BATCH))


def hybrid_numpy() -> Burst:
    def errors() -> Iterator[float]:
        A, b, w = np.eye(N), np.zeros(N), np.zeros(N)
        measured = np.zeros(N)
        measured[0] = 1.0
        predicted = measured.copy()
        first = 2 + LAGS
        for k, (x, e) in enumerate(zip(RESPONSE, ERROR, strict=True)):
            if k % BATCH == 0:
                w[:] = np.linalg.solve(A, b)
                predicted[first:] = measured[first:]
            measured[2:first] = measured[1 : first - 1].copy()
            measured[1] = x
            predicted[1:first] = measured[1:first]
            estimate = float(w @ predicted)
            A += np.outer(measured, measured)
            b += measured * e
            for features, newest in ((measured, e), (predicted, estimate)):
                features[first + 1 :] = features[first:-1].copy()
                features[first] = newest
            yield estimate

    running = errors()
    return lambda: np.fromiter(running, np.float64, SAMPLES)


def main() -> None:
    describe_machine()
    race(
        "recursive least squares, 55 regressors, forgetting 0.999: us a sample",
        [
            Racer(name="fdbench", start=lambda: ours(LAM, DELTA), units=SAMPLES, bar=0.7),
            Racer(name="FilterRLS, predict and adapt", start=padasip, units=SAMPLES, peer="padasip"),
            Racer(name="KalmanFilter of constant states", start=filterpy, units=SAMPLES, peer="filterpy"),
            Racer(name="NumPy loop", start=numpy_loop, units=SAMPLES),
        ],
        scale=1e6,
        rounds=ROUNDS,
    )
    race(
        "the same without forgetting: us a sample",
        [
            Racer(name="fdbench", start=lambda: ours(1.0, 1.0), units=SAMPLES),
            Racer(name="BayesianLinearRegression", start=river, units=SAMPLES, peer="river"),
        ],
        scale=1e6,
        rounds=ROUNDS,
    )
    race(
        "hybrid model, 55 features, a batch of 100 samples ahead: us a sample",
        [
            Racer(name="fdbench", start=hybrid, units=SAMPLES),
            Racer(name="NumPy loop", start=hybrid_numpy, units=SAMPLES),
        ],
        scale=1e6,
        rounds=ROUNDS,
    )
    scenario = load_scenario("ServoStaircase-v0")
    record, context = scenario.record(0), scenario.context()
    estimator = HybridRLS()
    n, sampling_time_s = record.n_samples, context.sampling_time_s
    times = race(
        f"hybrid_rls on the staircase, {n * sampling_time_s:g} s of record: us a sample",
        [
            Racer(
                name="response of the physics and fit", start=lambda: lambda: estimator.fit(context, record), units=n
            ),
            Racer(name="simulation of the record", start=lambda: lambda: scenario.record(0), units=n),
        ],
        scale=1e6,
        compare=None,
    )
    for name, time_us in times.items():
        print(f"{name}: {1e6 * sampling_time_s / time_us:.0f} x real time")


if __name__ == "__main__":
    main()
