"""A transfer function of 5 poles and 4 zeros from 400 noisy frequencies, beside scikit-rf and SciPy's AAA.

What is compared is the rms error against the response without noise, as a share of its rms. The NumPy twin solves the
same equations in plain powers of s, without scaling; vector fitting moves poles instead, and AAA interpolates.
"""

import warnings
from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._rational_fit import ComplexArray, FloatArray, fit_rational
from fdbench_baselines.frequency_least_squares import FrequencyLeastSquares

from fdbench.scenario import load_scenario

ITERATIONS, LANES = 4, 1024


def made_up() -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Return frequencies, and the response of a drive with two resonances with and without 1.4 % of noise."""
    omega = np.geomspace(2.0 * np.pi, 800.0 * np.pi, 400)
    s = 1j * omega
    modes = [1.0 / (s**2 + 2.0 * z * w * s + w**2) for z, w in ((0.04, 300.0), (0.03, 1200.0))]
    true = 1.0 / (s + 20.0) + 50.0 * modes[0] + 200.0 * modes[1]
    random = np.random.default_rng(0)
    noise = 0.01 * (random.standard_normal(400) + 1j * random.standard_normal(400))
    return omega, np.asarray(true * (1.0 + noise)), np.asarray(true)


OMEGA, NOISY, TRUE = made_up()


def error(found: Callable[[FloatArray], ComplexArray], _: object = None) -> float:
    return float(np.linalg.norm(found(OMEGA) - TRUE) / np.linalg.norm(TRUE))


def ours() -> Burst:
    return lambda: fit_rational(OMEGA, NOISY, 4, 5, relative=True, iterations=ITERATIONS).response


def plain() -> Burst:
    def burst() -> Callable[[FloatArray], ComplexArray]:
        s, weight = 1j * OMEGA, 1.0 / np.abs(NOISY)
        powers = np.vander(s, 6, increasing=True)
        columns = np.column_stack((powers[:, :5] * NOISY[:, None], -powers[:, :5]))
        for _ in range(ITERATIONS + 1):
            X, y = columns * weight[:, None], -powers[:, 5] * NOISY * weight
            c = np.linalg.lstsq(np.vstack((X.real, X.imag)), np.concatenate((y.real, y.imag)))[0]
            denominator = powers[:, :5] @ c[:5] + powers[:, 5]
            weight = 1.0 / np.abs(NOISY * denominator)
        return lambda omega: np.asarray(powers[:, :5] @ c[5:] / denominator)

    return burst


def aaa() -> Burst:
    peer = import_module("scipy.interpolate").AAA
    warnings.filterwarnings("ignore", "AAA failed to converge")  # in six terms, to the noise

    def burst() -> Callable[[FloatArray], ComplexArray]:
        found = peer(1j * OMEGA, NOISY, max_terms=6)
        return lambda omega: np.asarray(found(1j * omega))

    return burst


def scikit_rf() -> Burst:
    rf, fitting = import_module("skrf"), import_module("skrf.vectorFitting")
    network = rf.Network(f=OMEGA / (2.0 * np.pi), f_unit="Hz", s=NOISY[:, None, None])

    def burst() -> Callable[[FloatArray], ComplexArray]:
        peer = fitting.VectorFitting(network)
        peer.vector_fit(n_poles_real=1, n_poles_cmplx=2, fit_constant=False, fit_proportional=False)
        return lambda omega: np.asarray(peer.get_model_response(0, 0, omega / (2.0 * np.pi)))

    return burst


def main() -> None:
    describe_machine()
    race(
        f"transfer function, noise {error(lambda omega: NOISY):.1e}: ms",
        [
            Racer(name="fdbench, scaled powers of s", start=ours, bar=1.0),
            Racer(name="VectorFitting", start=scikit_rf, peer="scikit-rf"),
            Racer(name="AAA, 6 terms", start=aaa, peer="scipy"),
            Racer(name="NumPy lstsq, plain powers of s", start=plain),
        ],
        scale=1e3,
        rounds=60,
        compare=error,
        heading="error",
    )
    scenario = load_scenario("SlotMillingRunout575Rpm50N-v0")
    record, context = scenario.record(0), scenario.context()
    estimator, n = FrequencyLeastSquares(bins=range(1, 15)), record.n_samples
    lanes = scenario.system(LANES)
    lanes.start(range(LANES))
    race(
        f"slot milling, {n} samples: us a sample",
        [
            Racer(name="frequency_least_squares", start=lambda: lambda: estimator.fit(context, record), units=n),
            Racer(name="simulation of the record", start=lambda: lambda: scenario.record(0), units=n),
            Racer(
                name=f"simulation in {LANES} lanes, sample by sample",
                start=lambda: partial(lanes.advance, 1, np.zeros(LANES)),
                units=LANES,
            ),
        ],
        scale=1e6,
        rounds=60,
        compare=None,
    )


if __name__ == "__main__":
    main()
