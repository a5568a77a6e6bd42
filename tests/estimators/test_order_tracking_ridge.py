"""Order tracking on the spindle testbed: against closed forms of the machine, a slow twin, and the truth."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from fdbench_baselines._kernel_ridge import kernel, smoother
from fdbench_baselines.linear_regression import LinearRegression
from fdbench_baselines.order_tracking_ridge import (
    OrderTrackingRidge,
    learn_response,
    learn_shape,
    lines_of_orders,
    locate,
    track,
)

from fdbench.errors import RecordError, SpecError
from fdbench.estimator import BatchEstimator
from fdbench.plants._spindle_testbed_machine import FULL_WIDTH
from fdbench.plants._spindle_testbed_plan import ForceLevels, SpindleSpeeds
from fdbench.plants.spindle_testbed import SpindleTestbed
from fdbench.record import Record
from fdbench.scenario import Scenario, Truth, load_scenario
from fdbench.simulate.spectra import lines

SPEED_RAD_PER_S = 200.0


@cache
def small(case: str) -> tuple[Scenario, Record, Truth]:
    """Return a testbed of 61 speeds and 4 force levels, one speed or one level withheld."""
    scenario = load_scenario("SpindleTestbedSpeed-v0")
    plant, timing = scenario.plant, scenario.timing
    assert isinstance(plant, SpindleTestbed)
    assert timing is not None
    withheld = SpindleSpeeds(speeds_rad_per_s=(SPEED_RAD_PER_S,)) if case != "level" else ForceLevels(levels_N=(28.0,))
    machine = dataclasses.replace(plant.machine, angle_jitter_rad=100.0 if case == "no trigger" else 0.1)
    plant = dataclasses.replace(
        plant,
        lowest_speed_rad_per_s=80.0,
        highest_speed_rad_per_s=320.0,
        n_speeds=61,
        n_forces=4,
        withheld=withheld,
        machine=machine,
    )
    scenario = dataclasses.replace(
        scenario, plant=plant, timing=dataclasses.replace(timing, duration_s=61.0 * plant.n_forces)
    )
    return scenario, *scenario.observe(100)


def levels(record: Record) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return which of the four force levels each sample belongs to."""
    return np.asarray(np.arange(record.n_samples) // 500 % 4)


def error_percent(case: str, estimator: BatchEstimator) -> float:
    scenario, record, truth = small(case)
    context = scenario.context()
    force = estimator.fit(context, record).disturbance_N
    assert force is not None
    assert truth.disturbance_N is not None
    true = truth.disturbance_N[context.regression(record).rows]
    return 100.0 * float(np.sqrt(np.mean((force - true) ** 2) / np.mean(true**2)))


@pytest.mark.parametrize("case", ["speed", "level", "no trigger"])
def test_finds_the_force_at_a_new_speed_at_a_new_level_and_without_a_trigger(case: str) -> None:
    assert error_percent(case, OrderTrackingRidge()) < 5.0


def test_linear_regression_finds_nothing_at_the_new_speed() -> None:
    assert error_percent("speed", LinearRegression()) > 50.0


def test_learns_the_pulse_and_the_frequency_response_of_the_machine() -> None:
    scenario, record, _ = small("speed")
    plant = scenario.plant
    assert isinstance(plant, SpindleTestbed)
    tracked = track(plant, record)
    shape = learn_shape(tracked)
    response, _, curvature = learn_response(tracked, shape, 15)
    m = np.arange(1, 11)
    sigma = plant.machine.pulse_width_rad / FULL_WIDTH
    assert np.abs(shape[:10] - np.exp(-0.5 * sigma**2 * (m**2 - 1))).max() < 0.02
    share = SPEED_RAD_PER_S / 320.0
    frequencies_Hz = SPEED_RAD_PER_S / (2.0 * np.pi) * np.arange(1, 7)
    true = plant.machine.accelerance(2.0 * np.pi * frequencies_Hz, share)
    found = response(np.column_stack((frequencies_Hz, np.full(6, share)))) * frequencies_Hz**2
    assert np.abs(found - true).max() < 0.05 * np.abs(true).max()
    # a (1 + |a| / a_nl) is undone to first order by a coefficient of less than 1 / a_nl.
    assert 0.4 < curvature * plant.machine.nonlinear_acceleration_m_per_s2 < 1.0


def test_lines_of_orders_are_those_of_a_densely_sampled_signal() -> None:
    amplitudes = np.array([1.0 - 0.5j, 0.3j])
    start_s, length_s, n = 0.5, 0.5, 100_000
    time_s = start_s + length_s / n * (np.arange(n) + 0.5)
    signal = sum((a * np.exp(2j * np.pi * 7.3 * m * time_s)).real for m, a in enumerate(amplitudes, 1))
    assert isinstance(signal, np.ndarray)
    found = lines_of_orders(7.3, 2, 20, length_s, start_s) @ np.concatenate((amplitudes.real, amplitudes.imag))
    assert found == pytest.approx(lines(signal, 20), abs=2e-3)


@pytest.mark.parametrize("angle", [-3.0, 0.0, 1.234])
def test_locates_as_a_search_over_all_angles_does(angle: float) -> None:
    generator = np.random.default_rng(1)
    gain, offset, noise = generator.standard_normal((3, 2, 6))
    complex_gain, complex_offset = gain[0] + 1j * gain[1], offset[0] + 1j * offset[1]
    m = np.arange(1, 7)
    orders = (3.0 * complex_gain + complex_offset + 0.1 * (noise[0] + 1j * noise[1])) * np.exp(1j * angle * m)
    size, found = locate(orders[None, :], complex_gain, complex_offset)
    angles = np.linspace(-np.pi, np.pi, 20001)
    turned = orders * np.exp(-1j * np.outer(angles, m)) - complex_offset
    sizes = (turned @ complex_gain.conj()).real / np.sum(np.abs(complex_gain) ** 2)
    best = int(np.argmin(np.sum(np.abs(turned - sizes[:, None] * complex_gain) ** 2, axis=1)))
    assert np.angle(np.exp(1j * (found[0] - angles[best]))) == pytest.approx(0.0, abs=2e-3)
    assert size[0] == pytest.approx(sizes[best], rel=1e-3)


def test_a_force_is_not_negative() -> None:
    ones = np.ones(6, dtype=np.complex128)
    size, angle = locate(4.5 * ones[None, :], ones, 5.0 * ones)
    assert size[0] == 0.0
    assert angle[0] == pytest.approx(0.0, abs=1e-9)


def test_smoother_interpolates_between_noisy_values() -> None:
    x = np.linspace(0.0, 10.0, 60)[:, None]
    noise = 0.05 * np.random.default_rng(2).standard_normal((2, 60))
    values = np.sin(x[:, 0]) + 1j * np.cos(2.0 * x[:, 0]) + noise[0] + 1j * noise[1]
    at = np.linspace(0.5, 9.5, 200)[:, None]
    found = smoother(x, values, np.full(60, 0.05**2), np.array([0.3]))(at)
    error = found - np.sin(at[:, 0]) - 1j * np.cos(2.0 * at[:, 0])
    assert np.sqrt(np.mean(np.abs(error) ** 2)) < 0.05


def test_kernel_is_that_of_each_pair() -> None:
    points = np.random.default_rng(3).standard_normal((5, 2))
    pairs = [[np.exp(-0.5 * np.sum((p - q) ** 2)) for q in points[:3]] for p in points]
    assert kernel(points, points[:3]) == pytest.approx(np.array(pairs))


def test_refuses_what_it_cannot_do() -> None:
    with pytest.raises(SpecError, match="harmonics: 0"):
        OrderTrackingRidge(harmonics=0)
    scenario, record, _ = small("level")
    with pytest.raises(RecordError, match="the plan, which knows their speeds"):
        OrderTrackingRidge().fit(scenario.context(), record.slice(0, record.n_samples // 2))
    one_level = Record({**record.columns, "training_sample": np.where(levels(record) == 0, 1.0, 0.0)}, {}, "one level")
    with pytest.raises(RecordError, match="forces that differ"):
        OrderTrackingRidge().fit(scenario.context(), one_level)
    other = load_scenario("ShakerConstant-v0")
    assert OrderTrackingRidge().skip(other.context()) == "the plant has no plan of speeds"
    with pytest.raises(SpecError, match="no plan of speeds"):
        OrderTrackingRidge().fit(other.context(), record)
