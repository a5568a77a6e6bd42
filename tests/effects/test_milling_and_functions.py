"""The teeth of a cutter against a plain sum over them, and the elementary functions against those of NumPy."""

import math

import numpy as np
import pytest

from fdbench.effects import effects
from fdbench.effects._functions import cos, exp, log, plus_exp, power, sin, sin_cos

TURN = 2.0 * math.pi


def plain_force(t: float, feed: float, run_out: float, tool: dict[str, float]) -> float:
    """Return the sum that the data sheets of ``tooth_passing_force`` and ``runout_force`` state, tooth after tooth."""
    n, theta, total = int(tool["teeth"]), tool["direction_rad"], 0.0
    for j in range(n):
        angle = tool["spindle_frequency_Hz"] * t + 0.5 * tool["frequency_drift_Hz_per_s"] * t * t + j / n
        phi = (TURN * angle + tool["angle_rad"]) % TURN
        chip = abs(feed) / (tool["spindle_frequency_Hz"] * n) * math.sin(phi) + (run_out if j % 2 == 0 else -run_out)
        if not tool["entry_angle_rad"] < phi < tool["exit_angle_rad"] or chip <= 0.0:
            continue
        tangential = tool["axial_depth_m"] * (tool["tangential_cutting_Pa"] * chip + tool["tangential_edge_N_per_m"])
        radial = tool["axial_depth_m"] * (tool["radial_cutting_Pa"] * chip + tool["radial_edge_N_per_m"])
        total += math.cos(theta) * (-tangential * math.cos(phi) - radial * math.sin(phi))
        total += math.sin(theta) * (tangential * math.sin(phi) - radial * math.cos(phi))
    return math.copysign(1.0, feed) * total


@pytest.mark.parametrize("teeth", range(1, 13))
def test_forces_of_a_cutter_are_the_sum_over_its_teeth(teeth: int) -> None:
    random, kind, extra = np.random.default_rng(teeth), effects.get("tooth_passing_force"), effects.get("runout_force")
    for case in range(40):
        tool = {item.name: item.typical for item in kind.parameters()}
        tool |= {"teeth": float(teeth), "spindle_frequency_Hz": random.uniform(5.0, 50.0)}
        tool |= {name: random.uniform(-6.0, 6.0) for name in ("direction_rad", "angle_rad", "frequency_drift_Hz_per_s")}
        if case % 2:
            tool |= {"entry_angle_rad": random.uniform(0.0, 3.0), "exit_angle_rad": random.uniform(3.0, 6.28)}
        run_out = random.uniform(0.0, 1e-4)
        values = {**tool, "radial_runout_m": run_out}
        for t, feed in zip(random.uniform(0.0, 2.0, 20), random.uniform(-0.1, 0.1, 20), strict=True):
            smooth = kind.kernel(t, 1e-4, 0.0, feed, 0.0, *kind(**tool).values())[0]
            rough = extra.kernel(t, 1e-4, 0.0, feed, 0.0, *extra(**values).values())[0]
            size = tool["axial_depth_m"] * 1e6
            assert smooth == pytest.approx(plain_force(t, feed, 0.0, tool), abs=1e-9 * size)
            assert smooth + rough == pytest.approx(plain_force(t, feed, run_out, tool), abs=1e-9 * size)


def test_sine_and_cosine_together_have_the_bits_of_each() -> None:
    for x in np.random.default_rng(0).uniform(-1e3, 1e3, 2000):
        assert sin_cos(x) == (sin(x), cos(x))


def test_an_exponential_that_is_left_out_would_change_no_bit() -> None:
    random = np.random.default_rng(0)
    levels = [0.0, -2.0, 1.0, 120.0, 5e-324, 1e-300, 1e300, math.inf, *(10.0 ** random.uniform(-12.0, 12.0, 200))]
    for a in levels:
        for factor in (0.0, 1e-3, -0.5, 9.9e9, -9.9e9, 1.1e10, 1e27, 1e40):
            for x in (-1000.0, -800.0, -64.5, np.nextafter(-64.0, -65.0), -64.0, -1.0, 0.0, math.nan):
                b = factor * a if a else factor
                np.testing.assert_array_equal(plus_exp(a, b, x), a + b * exp(x))


def test_logarithm_is_within_a_unit_in_the_last_place() -> None:
    x = np.exp(np.random.default_rng(0).uniform(-50.0, 50.0, 2000))
    x = np.concatenate((x, 1.0 + np.random.default_rng(1).uniform(-1e-6, 1e-6, 200)))
    expected = np.log(x.astype(np.longdouble))
    error = np.abs(np.array([log(value) for value in x]) - expected) / np.spacing(np.abs(expected.astype(np.float64)))
    assert error.max() < 1.0


def test_powers() -> None:
    x = np.random.default_rng(0).uniform(1e-3, 10.0, 500)
    np.testing.assert_allclose([power(value, 0.73) for value in x], x**0.73, rtol=2e-15)
    assert power(0.0, 0.73) == power(-1.0, 0.73) == 0.0
    assert power(4.0, 0.5) == 2.0
