"""Spindle testbed of Qu and Vogl: machine against closed forms, solvers against twins, and the published rankings."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines._function_basis import NONLINEAR, expand
from fdbench_baselines._sparse_regression import FloatArray, least_squares, threshold_sequentially
from fdbench_baselines.slr_nfb import SlrNfb
from numpy.typing import NDArray

from fdbench.errors import RecordError, SpecError
from fdbench.estimator import Estimate, estimators
from fdbench.metrics import Outcome, metrics
from fdbench.plants import SpectralPlant
from fdbench.plants._spectra import Spectra
from fdbench.plants._spindle_testbed_machine import HousingMode, SpindleTestbedMachine, harmonic_sums
from fdbench.plants._spindle_testbed_plan import ForceLevels, RandomSegments, SpindleSpeeds
from fdbench.plants.spindle_testbed import SpindleTestbed
from fdbench.record import Record
from fdbench.scenario import Scenario, Truth, load_scenario
from fdbench.simulate.spectra import lines, signals
from fdbench.simulate.system import Noise
from fdbench.simulate.testbed import Plan, SpindleTestbedSystem

CASES = {"case 1": "Random", "case 2": "Force", "case 3": "Speed"}
WITHHELD = {"case 1": 780, "case 2": 800, "case 3": 156}
# Mean absolute error and error of the root mean square, N, by an independent calculation on the same machine.
LINEAR = {"case 1": (1.100, 0.459), "case 2": (1.173, 0.423), "case 3": (2.553, 0.985)}
BETTER = {"case 1": True, "case 2": True, "case 3": False}
RANDOM_ANGLE_RAD = 100.0
SAMPLES = 250  # in a segment


def bed(scenario: Scenario) -> SpindleTestbed:
    assert isinstance(scenario.plant, SpindleTestbed)
    return scenario.plant


def with_plant(scenario: Scenario, **changes: object) -> Scenario:
    return dataclasses.replace(scenario, plant=dataclasses.replace(bed(scenario), **changes))  # type: ignore[arg-type]


def with_machine(scenario: Scenario, **changes: object) -> Scenario:
    machine = dataclasses.replace(bed(scenario).machine, **changes)  # type: ignore[arg-type]
    return with_plant(scenario, machine=machine)


def small(n_speeds: int = 3, n_forces: int = 2, **changes: object) -> Scenario:
    """Return a testbed with few conditions and without noise; the first force level is withheld."""
    scenario = load_scenario("SpindleTestbedForce-v0")
    assert scenario.timing is not None
    changes = {"withheld": ForceLevels(levels_N=(4.0,)), **changes}
    scenario = with_plant(scenario, n_speeds=n_speeds, n_forces=n_forces, **changes)
    return dataclasses.replace(
        scenario,
        timing=dataclasses.replace(scenario.timing, duration_s=float(n_speeds * n_forces)),
        reality=dataclasses.replace(scenario.reality, noise=Noise()),
    )


def started(scenario: Scenario, seeds: list[int]) -> SpindleTestbedSystem:
    system = bed(scenario).system(scenario.setup, len(seeds))
    system.start(seeds)
    return system


@cache
def observed(case: str, jitter_rad: float = 0.1) -> tuple[Scenario, Record, Truth]:
    scenario = with_machine(load_scenario(f"SpindleTestbed{CASES[case]}-v0"), angle_jitter_rad=jitter_rad)
    return scenario, *scenario.observe(0)


@cache
def fitted(case: str, estimator: str, jitter_rad: float = 0.1) -> Outcome:
    scenario, record, truth = observed(case, jitter_rad)
    context = scenario.context()
    estimate = estimators.get(estimator)().fit(context, record)
    regression = context.regression(record)
    return Outcome(scenario=scenario, record=record, regression=regression, truth=truth, estimate=estimate, seconds=0.0)


def errors(case: str, estimator: str, jitter_rad: float = 0.1) -> tuple[float, float]:
    outcome = fitted(case, estimator, jitter_rad)
    mae, rms = metrics.get("force_mean_absolute_error")(), metrics.get("mean_rms_error")()
    assert mae.skip(outcome) is None
    assert rms.skip(outcome) is None
    return mae.score(outcome), rms.score(outcome)


# Published counts and rankings


@pytest.mark.parametrize("case", CASES)
def test_counts(case: str) -> None:
    scenario, record, _ = observed(case)
    spectra = bed(scenario).spectra(record)
    assert spectra.features.shape == spectra.targets.shape == (2600, 200)
    assert int((~spectra.training).sum()) == WITHHELD[case]
    assert expand(spectra.features, NONLINEAR).shape == (2600, 801)
    assert record.n_samples == 2600 * SAMPLES


def test_size_of_force_and_vibration() -> None:
    scenario, record, truth = observed("case 1")
    features = bed(scenario).spectra(record).features
    assert truth.disturbance_N is not None
    assert np.sqrt(np.mean(truth.disturbance_N**2)) == pytest.approx(3.44, rel=0.02)
    assert np.sqrt(np.mean(features**2)) == pytest.approx(0.041, rel=0.02)
    assert np.abs(features).max() == pytest.approx(0.96, rel=0.1)


@pytest.mark.parametrize("case", CASES)
def test_linear_regression_has_the_known_errors(case: str) -> None:
    assert errors(case, "linear_regression") == pytest.approx(LINEAR[case], rel=0.15)


@pytest.mark.parametrize("case", CASES)
def test_nonlinear_functions_help_unless_the_speed_is_new(case: str) -> None:
    for linear, nonlinear in zip(errors(case, "linear_regression"), errors(case, "lr_nfb"), strict=True):
        assert (nonlinear < linear) == BETTER[case]


def test_a_new_speed_is_harder_than_a_new_force_level() -> None:
    for estimator in ("linear_regression", "lr_nfb"):
        first, second, third = (errors(case, estimator)[0] for case in CASES)
        assert third > second > first


@pytest.mark.parametrize("case", ["case 1", "case 3"])
def test_sparse_regression_is_as_good_as_the_full_one(case: str) -> None:
    assert errors(case, "slr_nfb") == pytest.approx(errors(case, "lr_nfb"), rel=0.03)


@pytest.mark.parametrize("case", CASES)
def test_nothing_is_gained_where_the_phase_is_random(case: str) -> None:
    linear = errors(case, "linear_regression", RANDOM_ANGLE_RAD)
    nonlinear = errors(case, "lr_nfb", RANDOM_ANGLE_RAD)
    assert linear[0] < nonlinear[0]
    if case == "case 1":
        assert nonlinear[1] < linear[1]


def test_share_of_coefficients_that_is_kept() -> None:
    threshold, share, error_N = 3.0, 0.50, 0.97
    scenario, record, truth = observed("case 1")
    spectra = bed(scenario).spectra(record)
    G, training = expand(spectra.features, NONLINEAR), spectra.training
    found = threshold_sequentially(G[training], spectra.targets[training], threshold, 4).coefficients
    assert np.mean(found != 0.0) == pytest.approx(share, abs=0.02)
    assert truth.disturbance_N is not None
    error = spectra.signals(G[~training] @ found) - truth.disturbance_N.reshape(-1, SAMPLES)[~training]
    assert np.mean(np.abs(error)) == pytest.approx(error_N, rel=0.05)


# What an estimator may see


def test_withheld_force_is_in_no_column() -> None:
    scenario, record, truth = observed("case 2")
    rows = scenario.context().regression(record).rows
    assert truth.disturbance_N is not None
    withheld = truth.disturbance_N[rows]
    assert np.abs(withheld).max() > 10.0
    np.testing.assert_array_equal(record["force_N"][rows], 0.0)
    np.testing.assert_array_equal(record["training_sample"][rows], 0.0)
    assert np.all(np.delete(record["training_sample"], rows) == 1.0)
    for name, column in record.items():
        if name != "acceleration_m_per_s2" and np.ptp(column[rows]) > 0.0:
            assert abs(np.corrcoef(column[rows], withheld)[0, 1]) < 0.01
    assert not bed(scenario).spectra(record).targets[~bed(scenario).spectra(record).training].any()


def test_measured_force_is_the_truth_but_for_noise() -> None:
    _, record, truth = observed("case 2")
    assert truth.disturbance_N is not None
    seen = record["training_sample"] == 1.0
    noise = record["force_N"][seen] - truth.disturbance_N[seen]
    assert np.std(noise) == pytest.approx(0.05 * np.sqrt(2 * 100 / 5000), rel=0.01)


def test_splits() -> None:
    plan = Plan(np.linspace(1.0, 4.0, 4), np.linspace(10.0, 30.0, 3), 2, 10, 2)
    generator = np.random.default_rng(0)
    levels = ForceLevels(levels_N=(20.0,)).mask(plan, generator)
    assert levels[:, 1].all()
    assert not levels[:, [0, 2]].any()
    speeds = SpindleSpeeds(speeds_rad_per_s=(1.0, 3.99)).mask(plan, generator)
    assert speeds[[0, 3]].all()
    assert not speeds[1:3].any()
    segments = RandomSegments(number=6).mask(plan, generator)
    assert segments.sum() == 6
    assert (segments[..., 0] != segments[..., 1]).any()
    whole = RandomSegments(number=6, whole_conditions=True).mask(plan, generator)
    assert whole.sum() == 6
    np.testing.assert_array_equal(whole[..., 0], whole[..., 1])


def test_splits_that_cannot_be_had_are_refused() -> None:
    plan = Plan(np.linspace(1.0, 4.0, 4), np.linspace(10.0, 30.0, 3), 2, 10, 2)
    generator = np.random.default_rng(0)
    with pytest.raises(SpecError, match=r"levels_N: 21.5 is not in the plan. Did you mean 20"):
        ForceLevels(levels_N=(21.5,)).mask(plan, generator)
    with pytest.raises(SpecError, match="each once"):
        ForceLevels(levels_N=(10.0, 10.0)).mask(plan, generator)
    with pytest.raises(SpecError, match="not all 4"):
        SpindleSpeeds(speeds_rad_per_s=(1.0, 2.0, 3.0, 4.0)).mask(plan, generator)
    with pytest.raises(SpecError, match="24 of 24 segments"):
        RandomSegments(number=24).mask(plan, generator)
    with pytest.raises(SpecError, match="multiple of 2"):
        RandomSegments(number=5, whole_conditions=True).mask(plan, generator)


# The machine


def test_harmonic_sums_are_the_sums() -> None:
    random = np.random.default_rng(0)
    c = random.standard_normal((2, 7)) + 1j * random.standard_normal((2, 7))
    k = np.arange(1001)
    expected = (c @ np.exp(1j * 0.37 * np.outer(np.arange(1, 8), k))).real
    np.testing.assert_allclose(harmonic_sums(c, 0.37, len(k)), expected, rtol=0, atol=1e-11)


def quiet(**changes: object) -> SpindleTestbedMachine:
    """Return a machine with nothing but its modes."""
    machine = bed(load_scenario("SpindleTestbedForce-v0")).machine
    plain = {"unbalance": (), "cage_depth": 0.0, "nonlinear_acceleration_m_per_s2": 1e12}
    return dataclasses.replace(machine, **{**plain, **changes})  # type: ignore[arg-type]


def test_force_is_one_gaussian_pulse_a_revolution() -> None:
    machine = quiet(harmonics=200, highest_frequency_Hz=1e5)
    n = 20000
    force = machine.condition(2.0 * np.pi, 0.5, 30.0, 0.0, 0.0, 1.0 / n, n)[0]
    theta = 2.0 * np.pi * (np.arange(n) / n - 0.5)
    pulse = np.roll(30.0 * np.exp(-4.0 * np.log(2.0) * (theta / np.radians(14.0)) ** 2), n // 2)
    np.testing.assert_allclose(force, pulse - pulse.mean(), rtol=0, atol=0.005)


def test_vibration_obeys_the_equation_of_motion() -> None:
    mode = HousingMode(frequency_Hz=80.0, damping_ratio=0.05, mass_kg=4.0, frequency_change=-0.2, damping_change=1.0)
    step_s, n = 1e-5, 200_000
    force, acceleration = quiet(modes=(mode,)).condition(2.0 * np.pi * 25.0, 0.5, 10.0, 0.3, 0.0, step_s, n)
    natural, damping = 2.0 * np.pi * 80.0 * 0.9, 0.05 * 1.5

    def integral(x: FloatArray) -> FloatArray:
        total = np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * step_s)))
        return np.asarray(total - total[:-1].mean())

    velocity = integral(acceleration)
    position = integral(velocity)
    balance = 4.0 * (acceleration + 2.0 * damping * natural * velocity + natural**2 * position)
    np.testing.assert_allclose(balance, force, rtol=0, atol=2e-3 * np.abs(force).max())


def test_unbalance_modulation_and_nonlinearity() -> None:
    machine = bed(load_scenario("SpindleTestbedForce-v0")).machine
    n, speed, share = 4000, 200.0, 0.6
    force, acceleration = machine.condition(speed, share, 0.0, 0.4, 1.1, 1e-3, n)
    theta = 0.4 + speed * 1e-3 * np.arange(n)
    linear = 0.4 * share**2 * np.cos(theta + 0.7) + 0.12 * share * np.cos(2.0 * theta + 0.2)
    linear *= 1.0 + 0.1 * np.cos(0.42 * theta + 1.1)
    np.testing.assert_array_equal(force, 0.0)
    np.testing.assert_allclose(acceleration, linear + 0.15 * linear * np.abs(linear), rtol=0, atol=1e-9)


def test_logged_spectrum_is_that_of_the_acquired_signal() -> None:
    scenario = with_machine(small(), angle_jitter_rad=0.0, force_deviation=0.0, cage_depth=0.0)
    record, truth = scenario.observe(0)
    spectra = bed(scenario).spectra(record)
    machine, speeds = bed(scenario).machine, np.linspace(*np.array([400.0, 3000.0]) * np.pi / 30.0, 3)
    for number in range(6):
        speed, level = float(speeds[number // 2]), (4.0, 40.0)[number % 2]
        acquired = machine.condition(speed, speed / float(speeds[-1]), level, 0.0, 0.0, 1e-4, 10_000)
        expected = np.fft.rfft(acquired.reshape(2, 2, 5000))[..., 1:101] * (2.0 / 5000)
        both = np.concatenate((expected.real, expected.imag), axis=-1)
        segments = slice(2 * number, 2 * number + 2)
        np.testing.assert_allclose(spectra.features[segments], both[1], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(spectra.training[segments], level == 40.0)
        assert truth.disturbance_N is not None
        force = lines(truth.disturbance_N.reshape(-1, SAMPLES)[segments], 100)
        np.testing.assert_allclose(force, both[0], rtol=0, atol=1e-9)


def test_noise_has_the_stated_power_in_each_line() -> None:
    loud, silent = small(20, 4), small(20, 4)
    loud = dataclasses.replace(
        loud, reality=dataclasses.replace(loud.reality, noise=Noise(acceleration_m_per_s2=0.03, force_N=0.2))
    )
    noise = loud.record(1)["acceleration_m_per_s2"] - silent.record(1)["acceleration_m_per_s2"]
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(0.03 * np.sqrt(200 / 250), rel=0.02)
    part = lines(noise.reshape(-1, SAMPLES), 100)
    np.testing.assert_allclose(np.std(part, axis=1), 0.03 * np.sqrt(2 / 250), rtol=0.25)


# The system


def test_advancing_in_parts_gives_the_same_bits() -> None:
    whole = started(small(), [4]).advance(3000)
    system = started(small(), [4])
    parts = [system.advance(n) for n in (1, 499, 1, 700, 1799)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_a_lane_is_the_single_instance() -> None:
    action = np.array([0.0, 3.0, -1.0])
    lanes = started(small(), [4, 5, 6])
    both = np.concatenate([lanes.advance(250, action), lanes.advance(400, 2.0 * action)])
    for number in range(3):
        one = started(small(), [4 + number])
        single = np.concatenate([one.advance(250, action[[number]]), one.advance(400, 2.0 * action[[number]])])
        np.testing.assert_array_equal(both[:, :, number], single[:, :, 0])


def test_a_lane_starts_again_by_itself() -> None:
    system = started(small(), [4, 5])
    first = system.advance(300)
    system.start([4], np.array([0]))
    second = system.advance(300)
    np.testing.assert_array_equal(second[:, :, 0], first[:, :, 0])
    np.testing.assert_array_equal(second[:, :, 1], started(small(), [5]).advance(600)[300:, :, 0])


def test_seeds_differ() -> None:
    assert not np.array_equal(small().record(0)["acceleration_m_per_s2"], small().record(1)["acceleration_m_per_s2"])
    first, second = (observed_split(seed) for seed in (0, 1))
    assert first.sum() == second.sum() == 4
    assert not np.array_equal(first, second)


def observed_split(seed: int) -> NDArray[np.bool_]:
    scenario = small(withheld=RandomSegments(number=4))
    return bed(scenario).spectra(scenario.record(seed)).training == 0


def test_an_action_sets_the_force_level_of_the_next_condition() -> None:
    force = SpindleTestbedSystem.truth_columns.index("disturbance_N") + len(SpindleTestbedSystem.columns)
    plain = started(small(), [4]).advance(1500)[:, force, 0]
    system = started(small(), [4])
    acted = np.concatenate([system.advance(n, np.array([u])) for n, u in ((1, 2.0), (999, -3.0), (500, -3.0))])
    # Levels 4, 40 and 4 N; the action of the second call comes when the first condition is under way.
    np.testing.assert_allclose(acted[:500, force, 0], 1.5 * plain[:500], rtol=0, atol=1e-12)
    np.testing.assert_allclose(acted[500:1000, force, 0], 37.0 / 40.0 * plain[500:1000], rtol=0, atol=1e-12)
    np.testing.assert_allclose(acted[1000:, force, 0], 0.25 * plain[1000:], rtol=0, atol=1e-12)


def test_levels_outside_the_sensor_diverge() -> None:
    system = started(small(), [4, 5])
    last = system.advance(500, np.array([-5.0, 0.0]))[:, -1]
    np.testing.assert_array_equal(system.diverged, [True, False])
    np.testing.assert_array_equal(last[0], [1.0, 0.0])
    system.advance(500)
    assert system.diverged[0], "a lane stays diverged until it is started again"
    system.start([4], np.array([0]))
    assert not system.diverged.any()


def test_the_plan_ends() -> None:
    system = started(small(), [4])
    system.advance(3000)
    with pytest.raises(SpecError, match="ends after 3000 samples"):
        system.advance(1)


def test_environment_rewards_a_column_beside_its_reference() -> None:
    for name in CASES.values():
        scenario = load_scenario(f"SpindleTestbed{name}-v0")
        assert scenario.environment is not None
        system = scenario.system()
        assert scenario.environment.reward in system.columns
        assert f"reference_{scenario.environment.reward}" in system.commanded
        assert set(system.limits) == {*system.columns, *system.commanded}


def test_what_a_testbed_does_not_have_is_refused() -> None:
    scenario = small()
    assert scenario.timing is not None
    short = dataclasses.replace(scenario, timing=dataclasses.replace(scenario.timing, duration_s=5.0))
    with pytest.raises(SpecError, match="duration_s: 5 s; the plan of 3 speeds and 2 force levels lasts 6 s"):
        short.system()
    noise = dataclasses.replace(scenario.reality, noise=Noise(velocity_m_per_s=1.0))
    with pytest.raises(SpecError, match="velocity_m_per_s: a spindle testbed has no such reading"):
        dataclasses.replace(scenario, reality=noise).system()
    effects = load_scenario("ShakerConstant-v0").reality
    with pytest.raises(SpecError, match="a testbed takes none"):
        dataclasses.replace(scenario, reality=dataclasses.replace(effects, noise=Noise())).system()
    with pytest.raises(SpecError, match="bandwidth_Hz: 250 Hz"):
        with_plant(scenario, bandwidth_Hz=250.0).system()
    with pytest.raises(SpecError, match=r"segment_s: 0.501 s are 250.5 samples"):
        with_plant(scenario, segment_s=0.501).system()
    with pytest.raises(SpecError, match="highest_force_N: 3 is not above lowest_force_N, 4"):
        with_plant(scenario, highest_force_N=3.0)
    with pytest.raises(SpecError, match="model 'arx' is not offered"):
        bed(scenario).linear_model("arx")


# Spectra of a record


def test_lines_are_amplitudes_of_cosines() -> None:
    t = np.arange(250) * 0.002
    x = 7.0 + 3.0 * np.cos(2.0 * np.pi * 4.0 * t) - 2.0 * np.sin(2.0 * np.pi * 200.0 * t)
    found = lines(x, 100)
    expected = np.zeros(200)
    expected[1], expected[199] = 3.0, 2.0  # cos(a + pi/2) = -sin(a)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(signals(found, 250), x - 7.0, rtol=0, atol=1e-12)


def test_a_faster_record_has_the_same_lines() -> None:
    scenario = small()
    rows = bed(scenario).spectra(scenario.record(0))
    fast = signals(rows.features, 5000).ravel()
    record = Record(
        {
            "time_s": np.arange(len(fast)) * 1e-4,
            "acceleration_m_per_s2": fast,
            "force_N": signals(rows.targets, 5000).ravel(),
            "training_sample": np.repeat(rows.training, 5000).astype(np.float64),
        }
    )
    again = bed(scenario).spectra(record)
    np.testing.assert_allclose(again.features, rows.features, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.targets, rows.targets, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("training", "message"),
    [
        (np.r_[np.ones(250), np.zeros(249)], "a multiple of 250"),
        (np.r_[np.ones(251), np.zeros(249)], "in all of a segment"),
        (np.r_[np.ones(250), np.full(250, 0.5)], "in all of a segment"),
        (np.ones(500), "training_sample is 1 everywhere"),
        (np.zeros(500), "training_sample is 0 everywhere"),
    ],
)
def test_records_without_whole_segments_are_refused(training: FloatArray, message: str) -> None:
    n = len(training)
    columns = {name: np.zeros(n) for name in ("acceleration_m_per_s2", "force_N")}
    record = Record({"time_s": np.arange(n) * 0.002, **columns, "training_sample": training})
    with pytest.raises(RecordError, match=message):
        bed(small()).spectra(record)


# Metrics


def test_metrics_in_closed_form() -> None:
    outcome = fitted("case 3", "null")
    assert outcome.truth.disturbance_N is not None
    true = outcome.truth.disturbance_N[outcome.regression.rows]
    mae, rms = metrics.get("force_mean_absolute_error")(), metrics.get("mean_rms_error")()

    def scores(force: FloatArray) -> tuple[float, float]:
        claimed = dataclasses.replace(outcome, estimate=Estimate(disturbance_N=force))
        return mae.score(claimed), rms.score(claimed)

    assert scores(true) == (0.0, 0.0)
    mean_rms = np.mean(np.sqrt(np.mean(true.reshape(156, SAMPLES) ** 2, axis=1)))
    assert errors("case 3", "null") == pytest.approx((np.mean(np.abs(true)), mean_rms))
    assert scores(-true) == pytest.approx((2.0 * np.mean(np.abs(true)), 0.0), abs=1e-12)
    assert scores(1.1 * true) == pytest.approx((0.1 * np.mean(np.abs(true)), 0.1 * mean_rms))


def test_others_are_skipped_with_a_reason() -> None:
    shaker = load_scenario("ShakerConstant-v0").context()
    milling = load_scenario("SlotMilling-v0").context()
    for name in ("linear_regression", "lr_nfb", "slr_nfb"):
        assert estimators.get(name)().skip(milling) == "the plant offers no spectra"
        assert estimators.get(name)().skip(observed("case 3")[0].context()) is None
    assert not isinstance(shaker.plant, SpectralPlant)
    outcome = dataclasses.replace(fitted("case 3", "null"), scenario=load_scenario("ShakerConstant-v0"))
    for name in ("force_mean_absolute_error", "mean_rms_error"):
        assert metrics.get(name)().skip(outcome) == "the plant is not measured in segments"


# Solvers


def test_basis() -> None:
    G = expand(np.array([[-0.25, 4.0], [1.0, 0.0]]), (*NONLINEAR, "cosine"))
    expected = [1.0, -0.25, 4.0, 0.5, 2.0, 0.0625, 16.0, np.exp(-0.25), np.exp(4.0), np.cos(-0.5), np.cos(8.0)]
    np.testing.assert_allclose(G[0], expected)
    with pytest.raises(SpecError, match=r"unknown function 'squareroot'. Did you mean square_root"):
        expand(np.zeros((1, 1)), ("squareroot",))


def test_thresholding_has_the_exact_coefficients_and_solves() -> None:
    oracle = np.load(shared_file("oracles", "slr", "stls_80x6.npz"))
    threshold, iterations = float(oracle["threshold"]), int(oracle["max_iter"])
    found = threshold_sequentially(oracle["A"], oracle["Y"], threshold, iterations)
    np.testing.assert_array_equal(found.coefficients != 0.0, oracle["coef"] != 0.0)
    np.testing.assert_allclose(found.coefficients, oracle["coef"], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(found.solves, oracle["solves"])


def correlated(n: int, p: int, seed: int) -> FloatArray:
    """Return regressors whose neighbours resemble each other, in columns of very different size."""
    random = np.random.default_rng(seed)
    A = np.cumsum(random.standard_normal((n, p)), axis=1)
    return np.asarray(A * 10.0 ** random.uniform(-2.0, 1.0, p))


def plain(A: FloatArray, Y: FloatArray, threshold: float, iterations: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Solve output by output, each time from the start."""
    Z, solves = np.zeros((A.shape[1], Y.shape[1])), np.zeros(Y.shape[1], dtype=np.intp)
    for output in range(Y.shape[1]):
        support = np.ones(A.shape[1], dtype=np.bool_)
        for count in range(iterations + 1):
            Z[:, output] = 0.0
            Z[support, output] = np.linalg.lstsq(A[:, support], Y[:, output])[0]
            solves[output] = count + 1
            kept = support & (np.abs(Z[:, output]) >= threshold)
            if (kept == support).all() or not kept.any():
                if not kept.any() and count < iterations:
                    Z[:, output] = 0.0
                break
            support = kept
    return Z, solves


@pytest.mark.parametrize("iterations", [0, 1, 2, 10])
@pytest.mark.parametrize("threshold", [0.03, 0.3, 3.0])
def test_thresholding_is_that_of_a_plain_loop(threshold: float, iterations: int) -> None:
    A = correlated(120, 40, 1)
    Y = np.random.default_rng(2).standard_normal((120, 30)) + A @ np.random.default_rng(3).standard_normal((40, 30))
    Y[:, 10:15] = Y[:, :5]  # outputs of one support
    expected, solves = plain(A, Y, threshold, iterations)
    found = threshold_sequentially(A, Y, threshold, iterations)
    np.testing.assert_array_equal(found.coefficients != 0.0, expected != 0.0)
    np.testing.assert_allclose(found.coefficients, expected, rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(found.solves, solves)


def test_without_a_threshold_it_is_least_squares() -> None:
    A = correlated(120, 40, 1)
    Y = np.random.default_rng(2).standard_normal((120, 5))
    expected = np.linalg.lstsq(A, Y)[0]
    found = threshold_sequentially(A, Y, 0.0, 10)
    np.testing.assert_allclose(found.coefficients, expected, rtol=1e-9)
    np.testing.assert_array_equal(found.solves, 1)
    np.testing.assert_array_equal(least_squares(A, Y), found.coefficients)


def test_a_threshold_of_zero_is_the_full_regression_on_the_testbed() -> None:
    scenario, record, _ = observed("case 3")
    zero = SlrNfb(threshold=0.0).fit(scenario.context(), record).disturbance_N
    np.testing.assert_array_equal(np.asarray(zero), np.asarray(fitted("case 3", "lr_nfb").estimate.disturbance_N))


def test_the_last_solution_may_hold_smaller_coefficients() -> None:
    # Without the third column, which is tested first, the second drops below the threshold.
    A = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.1], [0.0, 0.0, 0.0]])
    y = A @ np.array([[3.0], [1.0], [-0.9]])
    once = threshold_sequentially(A, y, 0.95, 1)
    np.testing.assert_allclose(once.coefficients[:, 0], [3.0, 0.1, 0.0], atol=1e-12)
    twice = threshold_sequentially(A, y, 0.95, 2)
    np.testing.assert_allclose(twice.coefficients[:, 0], [3.0, 0.0, 0.0], atol=1e-12)
    assert (once.solves[0], twice.solves[0]) == (2, 3)


def test_the_condition_number_is_not_squared() -> None:
    random = np.random.default_rng(0)
    x = random.standard_normal((300, 4)) * 1e-3
    A = np.hstack([np.ones((300, 1)), x, x**2, np.exp(x)])  # condition number 1e10 after scaling
    Z = random.standard_normal((13, 3))
    assert np.linalg.cond(A / np.linalg.norm(A, axis=0)) > 1e9
    residual = A @ least_squares(A, A @ Z) - A @ Z
    assert np.abs(residual).max() < 1e-13
    sparse = threshold_sequentially(A, A @ Z, 1e-6, 10).coefficients
    assert np.abs(A @ sparse - A @ Z).max() < 1e-13


def test_columns_that_add_nothing_have_zero_coefficients() -> None:
    A = correlated(60, 6, 4)
    twice = np.column_stack((A, 3.0 * A[:, 2], A[:, 0] - A[:, 5]))
    Y = np.random.default_rng(5).standard_normal((60, 2))
    found = least_squares(twice, Y)
    np.testing.assert_array_equal(found[6:], 0.0)
    np.testing.assert_allclose(found[:6], np.linalg.lstsq(A, Y)[0], rtol=1e-9)


def test_arguments_out_of_bounds_are_refused() -> None:
    with pytest.raises(SpecError, match="3 training rows for 3 columns"):
        least_squares(np.eye(3), np.eye(3))
    with pytest.raises(SpecError, match="threshold: -1 is outside"):
        SlrNfb(threshold=-1.0)
    with pytest.raises(SpecError, match="iterations: -1 is negative"):
        SlrNfb(iterations=-1)


def test_inputs_are_left_alone() -> None:
    A, Y = correlated(60, 6, 4), np.ones((60, 2))
    before = A.copy(), Y.copy()
    threshold_sequentially(A, Y, 0.5, 3)
    np.testing.assert_array_equal(A, before[0])
    np.testing.assert_array_equal(Y, before[1])
    assert Spectra.__dataclass_params__.frozen  # type: ignore[attr-defined]
