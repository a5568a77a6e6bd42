"""CPU time and accuracy of a transfer function of 5 poles and 4 zeros, fitted to 400 noisy frequencies on one thread.

The twin solves the same equations in plain powers of s, without scaling, by one lstsq for each iteration. The response
is that of a made-up drive with two resonances; with the reference data present, also that file. A slot-milling record
is estimated whole, and simulated alone and in many lanes.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
from fdbench_baselines._rational_fit import ComplexArray, FloatArray, fit_rational
from fdbench_baselines.frequency_least_squares import FrequencyLeastSquares

from fdbench.scenario import load_scenario

ITERATIONS, REPEATS, LANES = 4, 100, 1024


class Response(NamedTuple):
    omega: FloatArray
    noisy: ComplexArray
    true: ComplexArray


def made_up() -> Response:
    omega = np.geomspace(2.0 * np.pi, 800.0 * np.pi, 400)
    s = np.asarray(1j * omega, dtype=np.complex128)
    modes = [1.0 / (s**2 + 2.0 * z * w * s + w**2) for z, w in ((0.04, 300.0), (0.03, 1200.0))]
    true = 1.0 / (s + 20.0) + 50.0 * modes[0] + 200.0 * modes[1]
    random = np.random.default_rng(0)
    noise = 0.01 * (random.standard_normal(400) + 1j * random.standard_normal(400))
    noisy = np.asarray(true * (1.0 + noise), dtype=np.complex128)
    return Response(omega, noisy, np.asarray(true, dtype=np.complex128))


def reference_data() -> Response | None:
    folder = Path(os.environ.get("FDBENCH_SHARED", Path(__file__).resolve().parents[2] / "shared"))
    file = folder / "oracles" / "freq_ls" / "frf_input.csv"
    if not file.exists():
        return None
    data = np.genfromtxt(file, delimiter=",", names=True)
    return Response(data["w"], data["re"] + 1j * data["im"], data["re_true"] + 1j * data["im_true"])


def plain(omega: FloatArray, response: ComplexArray, iterations: int) -> ComplexArray:
    s, weight = 1j * omega, 1.0 / np.abs(response)
    powers = np.vander(s, 6, increasing=True)
    columns = np.column_stack((powers[:, :5] * response[:, None], -powers[:, :5]))
    for _ in range(iterations + 1):
        X, y = columns * weight[:, None], -powers[:, 5] * response * weight
        c = np.linalg.lstsq(np.vstack((X.real, X.imag)), np.concatenate((y.real, y.imag)))[0]
        denominator = powers[:, :5] @ c[:5] + powers[:, 5]
        weight = 1.0 / np.abs(response * denominator)
    return np.asarray(powers[:, :5] @ c[5:] / denominator, dtype=np.complex128)


def best_ms(function: Callable[[], object], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        start = process_time()
        function()
        times.append(process_time() - start)
    return 1e3 * min(times)


def report(name: str, data: Response) -> None:
    def error(found: ComplexArray) -> float:
        return float(np.sqrt(np.mean(np.abs(found / data.true - 1.0) ** 2)))

    print(f"{name}: noise {error(data.noisy):.2e}")
    fitted = fit_rational(data.omega, data.noisy, 4, 5, relative=True, iterations=ITERATIONS)
    ours = best_ms(lambda: fit_rational(data.omega, data.noisy, 4, 5, relative=True, iterations=ITERATIONS))
    print(f"  scaled powers of s      {ours:6.2f} ms   relative error {error(fitted.response(data.omega)):.2e}")
    twin = best_ms(lambda: plain(data.omega, data.noisy, ITERATIONS))
    print(f"  plain powers of s       {twin:6.2f} ms   relative error {error(plain(data.omega, data.noisy, 4)):.2e}")


def main() -> None:
    report("made-up drive", made_up())
    data = reference_data()
    if data is not None:
        report("reference data", data)
    scenario = load_scenario("SlotMillingRunout575Rpm50N-v0")
    record, context = scenario.observe(0)[0], scenario.context()
    estimator = FrequencyLeastSquares(bins=range(1, 15))
    print("slot milling, 1536 samples:")
    print(f"  estimate                {best_ms(lambda: estimator.fit(context, record)):6.2f} ms")
    one, many = scenario.system(1), scenario.system(LANES)

    def episode() -> None:
        one.start([0])
        one.advance(one.n_samples)

    many.start(range(LANES))
    action = np.zeros(LANES)
    print(f"  simulated, one call     {best_ms(episode):6.2f} ms")
    print(f"  one sample, {LANES} lanes  {best_ms(lambda: many.advance(1, action)):6.3f} ms")


if __name__ == "__main__":
    main()
