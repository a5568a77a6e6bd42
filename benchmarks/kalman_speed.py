"""A step of the Kalman filter with 7 states, 1 input and 1 output, beside filterpy, statsmodels, dynamax and others.

What is compared is the last state and its variance after each reading. Peers count time from the first reading, so
they start from the state and covariance predicted for it; those that apply an input after a reading get the next one.
"""

from importlib import import_module
from typing import Any

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines import _kalman_filter as kf

STATES, SAMPLES, SHORT = 7, 2000, 200
SERIES = 200
Arrays = tuple[kf.FloatArray, kf.FloatArray]


def model_of(n: int, random: np.random.Generator) -> kf.Observer:
    A = random.standard_normal((n, n))
    A *= 0.98 / np.abs(np.linalg.eigvals(A)).max()
    root = random.standard_normal((n, n))
    return kf.Observer(
        A, random.standard_normal((n, 1)), random.standard_normal((1, n)), root @ root.T, np.ones(1), np.eye(n)
    )


RANDOM = np.random.default_rng(0)
MODEL = model_of(STATES, RANDOM)
A, B, C, Q, _, P = MODEL
R = np.diag(MODEL.R)
U, Y = RANDOM.standard_normal((SAMPLES, 1)), RANDOM.standard_normal((SAMPLES, 1))
FIRST, FIRST_P = B @ U[0], A @ P @ A.T + Q  # predicted for the first reading


def ours() -> Burst:
    return lambda: kf.filter_readings(MODEL, np.zeros(STATES), P.copy(), U, Y)[0][:, 2:]


def numpy_loop() -> Burst:
    def burst() -> kf.FloatArray:
        x, V, eye, out = np.zeros(STATES), P, np.eye(STATES), np.empty((SHORT, 2))
        for k in range(SHORT):
            x, V = A @ x + B @ U[k], A @ V @ A.T + Q
            K = V @ C.T / (C @ V @ C.T + R)
            x = x + K @ (Y[k] - C @ x)
            rest = eye - K @ C
            V = rest @ V @ rest.T + K @ R @ K.T
            out[k] = x[-1], V[-1, -1]
        return out

    return burst


def filterpy_filter() -> Any:
    peer = import_module("filterpy.kalman").KalmanFilter(dim_x=STATES, dim_z=1, dim_u=1)
    peer.F, peer.B, peer.H, peer.Q, peer.R = A, B, C, Q, R
    peer.x, peer.P = np.zeros((STATES, 1)), P
    return peer


def filterpy() -> Burst:
    filterpy_filter()

    def burst() -> kf.FloatArray:
        peer, out = filterpy_filter(), np.empty((SHORT, 2))
        for k in range(SHORT):
            peer.predict(U[k, :, None])
            peer.update(Y[k])
            out[k] = peer.x[-1, 0], peer.P[-1, -1]
        return out

    return burst


def statsmodels(**options: float) -> Burst:
    module = import_module("statsmodels.tsa.statespace.kalman_filter")
    intercept = np.zeros((STATES, SAMPLES))
    intercept[:, :-1] = B @ U[1:].T
    peer = module.KalmanFilter(k_endog=1, k_states=STATES, **options)
    peer.bind(Y.copy())
    matrices = {"design": C, "obs_cov": R, "transition": A, "selection": np.eye(STATES), "state_cov": Q}
    for name, matrix in (matrices | {"state_intercept": intercept}).items():
        peer[name] = matrix
    peer.initialize_known(FIRST, FIRST_P)

    def burst() -> kf.FloatArray:
        found = peer.filter()
        return np.column_stack((found.filtered_state[-1], found.filtered_state_cov[-1, -1]))

    return burst


def dynamax() -> Burst:
    lgssm, jax = import_module("dynamax.linear_gaussian_ssm.inference"), import_module("jax")
    empty, D = np.zeros(STATES), np.zeros((1, 1))
    parameters = lgssm.ParamsLGSSM(
        initial=lgssm.ParamsLGSSMInitial(mean=FIRST, cov=FIRST_P),
        dynamics=lgssm.ParamsLGSSMDynamics(weights=A, bias=empty, input_weights=B, cov=Q),
        emissions=lgssm.ParamsLGSSMEmissions(weights=C, bias=np.zeros(1), input_weights=D, cov=R),
    )
    step = jax.jit(lgssm.lgssm_filter)

    def burst() -> kf.FloatArray:
        found = step(parameters, Y, U)
        return np.column_stack((found.filtered_means[:, -1], found.filtered_covariances[:, -1, -1]))

    return burst


def simdkalman(series: int) -> Burst:
    """Return the burst of a filter without input: the response to the input alone is taken off before, and added."""
    peer = import_module("simdkalman").KalmanFilter(A, Q, C, R)
    response, states = np.empty((SHORT, STATES)), np.zeros(STATES)
    for k in range(SHORT):
        response[k] = states = A @ states + B @ U[k]
    data = np.tile((Y[:SHORT] - response @ C.T)[:, 0], (series, 1))

    def burst() -> kf.FloatArray:
        initial = {"initial_value": np.zeros(STATES), "initial_covariance": FIRST_P}
        found = peer.compute(data, 0, **initial, filtered=True, smoothed=False).filtered.states
        return np.column_stack((found.mean[0, :, -1] + response[:, -1], found.cov[0, :, -1, -1]))

    return burst


def pykalman() -> Burst:
    offsets = (B @ U[1:SHORT].T).T
    peer = import_module("pykalman").KalmanFilter(A, C, Q, R, offsets, np.zeros(1), FIRST, FIRST_P)

    def burst() -> kf.FloatArray:
        means, covariances = peer.filter(Y[:SHORT])
        return np.column_stack((means[:, -1], covariances[:, -1, -1]))

    return burst


def ours_steady() -> Burst:
    constant = kf.steady_filter(MODEL)
    return lambda: kf.run_constant_filter(constant, np.zeros(STATES), U, Y)[:, [kf.FORCE]]


def filterpy_steady() -> Burst:
    peer, out = filterpy_filter(), np.empty((SHORT, 1))
    peer.K = kf.gain(kf.steady_covariance(MODEL), C, MODEL.R)

    def burst() -> kf.FloatArray:
        peer.x = np.zeros((STATES, 1))
        for k in range(SHORT):
            peer.predict_steadystate(U[k, :, None])
            peer.update_steadystate(Y[k])
            out[k] = peer.x[-1]
        return out

    return burst


def main() -> None:
    describe_machine()
    race(
        "Kalman filter, covariance updated in each step: us a step",
        [
            Racer(name="fdbench, Joseph form", start=ours, units=SAMPLES, bar=0.35),
            Racer(name="jit", start=dynamax, units=SAMPLES, peer="dynamax"),
            Racer(name="Cython", start=lambda: statsmodels(tolerance=0.0), units=SAMPLES, peer="statsmodels"),
            Racer(
                name=f"{SERIES} series at once",
                start=lambda: simdkalman(SERIES),
                units=SERIES * SHORT,
                peer="simdkalman",
                note="a step of one series",
            ),
            Racer(name="1 series", start=lambda: simdkalman(1), units=SHORT, peer="simdkalman"),
            Racer(name="predict and update", start=filterpy, units=SHORT, peer="filterpy"),
            Racer(name="filter", start=pykalman, units=SHORT, peer="pykalman"),
            Racer(name="NumPy loop, Joseph form", start=numpy_loop, units=SHORT),
        ],
        scale=1e6,
    )
    race(
        "Kalman filter of constant gain: us a step",
        [
            Racer(name="fdbench", start=ours_steady, units=SAMPLES),
            Racer(name="predict and update _steadystate", start=filterpy_steady, units=SHORT, peer="filterpy"),
        ],
        scale=1e6,
    )


if __name__ == "__main__":
    main()
