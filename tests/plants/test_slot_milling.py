"""Slot milling and frequency-domain least squares against Turkay and Ulsoy (1988) and an FRF of known truth."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from conftest import shared_file
from fdbench_baselines._rational_fit import fit_rational
from fdbench_baselines.frequency_least_squares import FrequencyLeastSquares, jacobian
from fdbench_baselines.least_squares import LeastSquares
from numpy.typing import NDArray

from fdbench import reproduce
from fdbench.effects import Effect, effects
from fdbench.errors import RecordError, SimulationDiverged, SpecError
from fdbench.estimator import Estimate
from fdbench.motions.schroeder_multisine import SchroederMultisine
from fdbench.plants import _slot_milling as milling
from fdbench.plants._plant import TransferFunctionPlant
from fdbench.plants.slot_milling import SlotMilling
from fdbench.record import Record
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.system import Noise, System

pytestmark = pytest.mark.linear_algebra

QUIET = "SlotMilling-v0"
RUNOUT = [f"SlotMillingRunout{rpm}Rpm{force}N-v0" for rpm in (575, 200) for force in (50, 25)]
NAMES = ("a_1", "a_2", "b_0", "b_1")
PER_MM = np.array([1.0, 1.0, 1e-3, 1e-3])
C = (3.3, 9.0, 4798.416e3, 1759.419e3)
ZOH = np.array([-1.966653, 0.967539, 17.541743, -17.069768])
BINS = tuple(range(1, 15))
TABLE_2 = {
    QUIET: (-1.9745, 0.9751, 17.870, -17.689),
    RUNOUT[0]: (0.0340, -0.4567, -612.97, 713.28),
    RUNOUT[1]: (-0.1595, -0.6504, -165.29, 218.15),
    RUNOUT[2]: (-1.8541, 0.9554, -96.052, 109.784),
    RUNOUT[3]: (-1.8753, 0.9214, -32.549, 39.632),
}
TABLE_3 = {
    QUIET: (3.317, 9.107, 4893.6, 1765.3),
    RUNOUT[0]: (3.306, 9.057, 4863.2, 1767.4),
    RUNOUT[1]: (3.311, 9.082, 4878.5, 1766.3),
    RUNOUT[2]: (3.007, 7.923, 4121.2, 1821.6),
    RUNOUT[3]: (3.175, 8.508, 4529.1, 1793.8),
}

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def plant_of(scenario: Scenario) -> SlotMilling:
    assert isinstance(scenario.plant, SlotMilling)
    return scenario.plant


def changed(scenario: Scenario, *, substeps: int | None = None, **fields: Any) -> Scenario:
    """Return a scenario with fields of the plant or, where the plant has none of that name, of the motion replaced."""
    names = {field.name for field in dataclasses.fields(SlotMilling)}
    plant = dataclasses.replace(plant_of(scenario), **{key: value for key, value in fields.items() if key in names})
    motion: Any = scenario.motion
    motion = dataclasses.replace(motion, **{key: value for key, value in fields.items() if key not in names})
    timing = scenario.timing
    assert timing is not None
    if substeps is not None:
        timing = dataclasses.replace(timing, substeps=substeps)
    return dataclasses.replace(scenario, plant=plant, motion=motion, timing=timing)


def with_effects(scenario: Scenario, *added: Effect) -> Scenario:
    return dataclasses.replace(scenario, reality=dataclasses.replace(scenario.reality, effects=added))


def discrete(result: Estimate) -> FloatArray:
    assert tuple(result.parameters) == NAMES
    return np.asarray(np.array(list(result.parameters.values())) * PER_MM)


def continuous(scenario: Scenario, result: Estimate) -> FloatArray:
    values = scenario.linear_model.physical_parameters(result.parameters, 0.01)
    return np.asarray(np.array(list(values.values())) * PER_MM)


def fit(scenario: Scenario, estimator: LeastSquares | FrequencyLeastSquares) -> Estimate:
    return estimator.fit(scenario.context(), scenario.observe(0)[0])


# ---- the acceptance list ----


def test_tu1_derived_constants() -> None:
    plant = plant_of(load_scenario(QUIET))
    assert plant.gain_N_s_per_m == pytest.approx(533.1573e3, rel=1e-6)
    assert plant.steady_force_N == pytest.approx(618.6085, rel=1e-6)
    assert plant.coefficients == pytest.approx(C, rel=1e-6)
    model = plant.linear_model("arx")
    truth = model.nominal_parameters(0.01)
    assert tuple(model.physical_parameters(truth, 0.01).values()) == pytest.approx(C, rel=1e-6)


def test_tu2_held_input_equivalent() -> None:
    truth = load_scenario(QUIET).observe(0)[1].parameters
    assert tuple(truth) == NAMES
    np.testing.assert_allclose(np.array(list(truth.values())) * PER_MM, ZOH, rtol=0.0, atol=1e-6)


def test_tu3_time_domain_is_exact_on_a_linear_plant_with_held_input() -> None:
    scenario = changed(load_scenario(QUIET), linearised=True, hold_input=True)
    truth = scenario.linear_model.nominal_parameters(0.01)
    result = fit(scenario, LeastSquares())
    for name in NAMES:
        assert result.parameters[name] == pytest.approx(truth[name], rel=1e-9)


@pytest.mark.parametrize("name", TABLE_2)
def test_tu4_table_2(name: str) -> None:
    found = discrete(fit(load_scenario(name), LeastSquares()))
    np.testing.assert_allclose(found[:2], TABLE_2[name][:2], rtol=0.0, atol=0.002)
    np.testing.assert_allclose(found[2:], TABLE_2[name][2:], rtol=0.01)


def test_tu5_frequency_domain_is_exact_on_a_linear_plant_with_whole_periods() -> None:
    scenario = changed(load_scenario(QUIET), linearised=True, fundamental_rad_per_s=2.0 * math.pi / 5.12)
    for estimator in (FrequencyLeastSquares(bins=BINS), FrequencyLeastSquares(), FrequencyLeastSquares(relative=True)):
        found = continuous(scenario, fit(scenario, estimator))
        np.testing.assert_allclose(found, np.array(C) * PER_MM, rtol=1e-5)


@pytest.mark.parametrize("name", RUNOUT)
def test_tu6_frequency_domain_is_50_times_better_under_runout(name: str) -> None:
    scenario = load_scenario(name)
    truth = scenario.linear_model.nominal_parameters(0.01)["b_0"]
    time, frequency = (
        abs(fit(scenario, estimator).parameters["b_0"] / truth - 1.0)
        for estimator in (LeastSquares(), FrequencyLeastSquares(bins=BINS))
    )
    assert time > 50.0 * frequency


@pytest.mark.parametrize("name", TABLE_3)
def test_table_3_of_this_signal(name: str) -> None:
    scenario = load_scenario(name)
    found = continuous(scenario, fit(scenario, FrequencyLeastSquares(bins=BINS)))
    np.testing.assert_allclose(found, TABLE_3[name], rtol=3e-4)


def test_reproduction_rows_hold() -> None:
    rows = reproduce.run("turkay")
    assert [row.item for row in rows if not row.ok] == []
    items = [row.item for row in rows]
    assert len(items) == len(set(items))
    assert sum(item.startswith("table 2, d = ") for item in items) >= 20
    assert sum(row.kind == "not reproducible" for row in rows) == 48
    assert all(row.reason for row in rows if row.kind == "not reproducible")


# ---- the process ----


def runge_kutta(scenario: Scenario, n_samples: int, steps: int = 40) -> FloatArray:
    """Return F at the samples by classical Runge-Kutta steps on eq. (8), written out from the paper."""
    motion = scenario.motion
    assert isinstance(motion, SchroederMultisine)
    k = np.arange(1, 17)
    theta = -2.0 * np.pi * np.array([np.sum([j / 16.0 for j in range(1, m)]) for m in k])

    def slope(t: float, x: FloatArray) -> FloatArray:
        u = 0.847 + 0.2 * float(np.sum(np.sqrt(1.0 / 32.0) * np.cos(k * 1.2275 * t + theta)))
        w = 150.0 * 3.0**1.4 * u**0.73
        return np.array([-3.3 * x[0] + x[1] + 3.3 * w, -9.0 * x[0] + 9.0 * w])

    h, x, force = 0.01 / steps, np.zeros(2), np.zeros(n_samples)
    for sample in range(1, n_samples):
        for step in range(steps):
            t = 0.01 * (sample - 1) + step * h
            k_1 = slope(t, x)
            k_2 = slope(t + h / 2, x + h / 2 * k_1)
            k_3 = slope(t + h / 2, x + h / 2 * k_2)
            x = x + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + slope(t + h, x + h * k_3))
        force[sample] = x[0]
    return force


def test_agrees_with_runge_kutta() -> None:
    scenario = load_scenario(QUIET)
    record, _ = scenario.observe(0)
    np.testing.assert_allclose(record["force_N"][:100], runge_kutta(scenario, 100), rtol=0.0, atol=1e-7)


def test_substeps_converge_with_fourth_order() -> None:
    scenario = load_scenario(QUIET)
    force = [changed(scenario, substeps=n).observe(0)[0]["force_N"] for n in (2, 4, 16)]
    coarse, fine = (float(np.abs(values - force[2])[1024:].max()) for values in force[:2])
    assert coarse < 1e-5
    assert 14.0 < coarse / fine < 18.0


def test_held_input_is_exact_with_one_substep() -> None:
    scenario = changed(load_scenario(QUIET), hold_input=True)
    one, many = (changed(scenario, substeps=n).observe(0)[0]["force_N"] for n in (1, 7))
    np.testing.assert_allclose(one, many, rtol=1e-12)
    assert np.abs(one - load_scenario(QUIET).observe(0)[0]["force_N"])[1024:].max() > 0.1


def test_linearised_process_is_the_tangent() -> None:
    scenario = changed(load_scenario(QUIET), scale_m_per_s=1e-6)
    F_0 = plant_of(scenario).steady_force_N
    power, tangent = (
        changed(scenario, linearised=linear).observe(0)[0]["force_N"][1024:] - F_0 for linear in (False, True)
    )
    assert np.abs(tangent).max() > 0.1
    np.testing.assert_allclose(power, tangent, rtol=0.0, atol=2e-3 * float(np.abs(tangent).max()))


def test_runout_is_added_to_the_reading_alone() -> None:
    quiet = load_scenario(QUIET).observe(0)[0]
    record, truth = load_scenario(RUNOUT[0]).observe(0)
    runout = 50.0 * np.sin(240.86 * quiet["time_s"])
    np.testing.assert_allclose(record["force_N"] - quiet["force_N"], runout, rtol=0.0, atol=1e-9)
    assert truth.disturbance_N is not None
    np.testing.assert_allclose(truth.disturbance_N, runout, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(record["feedrate_m_per_s"], quiet["feedrate_m_per_s"])
    assert load_scenario(QUIET).observe(0)[1].disturbance_N is None


def system(name: str, n_lanes: int) -> System:
    result = load_scenario(name).system(n_lanes)
    result.start(list(range(n_lanes)))
    return result


def test_lanes_and_splits_have_the_bits_of_one_run() -> None:
    action = np.resize([0.0, 5e-5, -8e-5], 11)
    single = [system(RUNOUT[2], 1) for _ in action]
    lanes = system(RUNOUT[2], len(action))
    together = np.concatenate([lanes.advance(n, action) for n in (1, 7, 250)])
    for lane, alone in enumerate(single):
        np.testing.assert_array_equal(together[:, :, lane], alone.advance(258, action[lane : lane + 1])[:, :, 0])
    lanes.start([9], np.array([1]))
    again = lanes.advance(258, action)
    np.testing.assert_array_equal(again[:, :, 1], together[:, :, 1])
    assert not np.array_equal(again[:, :, 0], together[:, :, 0])


def test_noise_of_the_reading_is_the_seeds_own() -> None:
    quiet = load_scenario(QUIET)
    scenario = dataclasses.replace(quiet, reality=dataclasses.replace(quiet.reality, noise=Noise(force_N=2.0)))
    lanes = scenario.system(3)
    lanes.start([4, 5, 6])
    together = np.concatenate([lanes.advance(n) for n in (100, 1, 1435)])[:, lanes.columns.index("force_N")]
    noise = together - quiet.observe(0)[0]["force_N"][:, None]
    assert np.std(noise, axis=0) == pytest.approx([2.0, 2.0, 2.0], rel=0.1)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.1
    for lane, seed in enumerate((4, 5, 6)):
        np.testing.assert_array_equal(together[:, lane], scenario.observe(seed)[0]["force_N"])


def test_action_adds_to_the_feedrate_over_the_coming_sample() -> None:
    lanes = system(QUIET, 2)
    first = lanes.advance(1, np.array([0.0, 1e-4]))[0]
    second = lanes.advance(1, np.zeros(2))[0]
    feedrate, force = lanes.columns.index("feedrate_m_per_s"), lanes.columns.index("force_N")
    assert first[feedrate, 1] - first[feedrate, 0] == pytest.approx(1e-4)
    assert first[force, 1] == first[force, 0] == 0.0
    assert second[feedrate, 1] == second[feedrate, 0]
    assert second[force, 1] > second[force, 0] > 0.0


def test_a_negative_feedrate_diverges_and_stays_flagged() -> None:
    lanes = system(QUIET, 2)
    lanes.advance(1, np.array([0.0, -1e-3]))
    rows = lanes.advance(5)
    assert lanes.diverged.tolist() == [False, True]
    assert lanes.truth_columns[-1] == "diverged"
    np.testing.assert_array_equal(rows[:, -1, :], [[0.0, 1.0]] * 5)
    assert np.isfinite(rows).all()
    lanes.start([0, 1])
    assert not lanes.diverged.any()


def test_limits_end_an_episode() -> None:
    with pytest.raises(SimulationDiverged):
        changed(load_scenario(QUIET), force_limit_N=500.0).observe(0)
    with pytest.raises(SimulationDiverged):
        changed(load_scenario(QUIET), feedrate_limit_m_per_s=0.001).observe(0)


def test_limits_and_rest_are_those_of_the_columns() -> None:
    process = system(RUNOUT[0], 1)
    rows = process.advance(process.n_samples)[:, : len(process.columns), 0]
    assert (np.abs(rows).max(axis=0) <= [process.limits[name] for name in process.columns]).all()
    assert process.at_rest.shape == (len(process.columns),)
    np.testing.assert_array_equal(process.at_rest, rows[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: changed(s, scale_m_per_s=1e-3), r"motion: the feedrate falls to -6\.\d+e-05 m/s"),
        (lambda s: changed(s, substeps=1), r"timing\.substeps: .* 0\.005 s, so at least 2 substeps"),
        (lambda s: changed(s, settling_time_s=20.0), r"timing\.duration_s: 15\.36 s end before .* 20 s"),
        (
            lambda s: dataclasses.replace(
                s, reality=dataclasses.replace(s.reality, noise=Noise(motor_position_m=1e-9))
            ),
            r"reality\.noise\.motor_position_m: slot milling has no such reading",
        ),
        (
            lambda s: with_effects(s, *(e.typical() for e in map(effects.get, ["encoder_quantisation"]))),
            r"encoder_quantisation acts on a feed drive's",
        ),
        (
            lambda s: with_effects(s, *(e.typical() for e in map(effects.get, ["lugre_friction"]))),
            r"lugre_friction acts on a feed drive's",
        ),
    ],
    ids=["feedrate", "substep", "settling", "noise", "port", "states"],
)
def test_setups_that_make_no_sense_are_refused(change: Any, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        change(load_scenario(QUIET)).observe(0)


def test_an_episode_has_an_end() -> None:
    process = system(QUIET, 1)
    process.advance(1536)
    with pytest.raises(SpecError, match="episode ends after 1536 samples"):
        process.advance(1)


def test_multisine_is_flat_and_of_low_peak() -> None:
    motion = SchroederMultisine(
        mean_velocity_m_per_s=0.0,
        scale_m_per_s=2.0,
        harmonics=16,
        fundamental_rad_per_s=2.0 * math.pi / 5.12,
        first_phase_rad=0.0,
    )
    position, velocity, acceleration = motion.reference(0.01, 1024).T
    amplitude = np.abs(np.fft.rfft(velocity[:512])) / 256.0
    np.testing.assert_allclose(amplitude[1:17], 2.0 * math.sqrt(1.0 / 32.0), rtol=1e-12)
    np.testing.assert_allclose(amplitude[17:], 0.0, atol=1e-12)
    np.testing.assert_allclose(velocity[512:], velocity[:512], atol=1e-11)
    assert float(np.sqrt(np.mean(velocity[:512] ** 2))) == pytest.approx(1.0, rel=1e-12)
    assert np.ptp(velocity) / 2.0 < 1.75
    np.testing.assert_allclose(np.gradient(position, 0.01)[1:-1], velocity[1:-1], atol=0.02)
    np.testing.assert_allclose(np.gradient(velocity, 0.01)[1:-1], acceleration[1:-1], atol=0.5)
    assert position[0] == 0.0


# ---- maps between coefficients ----


@pytest.mark.parametrize("c", [C, (9.0, 9.0, 2.0, -1.0), (6.0, 9.0, 2.0, 1.0), (-0.2, 4.0, 1.0, 0.5)])
def test_discrete_coefficients_against_the_matrix_exponential_and_back(c: tuple[float, float, float, float]) -> None:
    from scipy.linalg import expm

    c_1, c_2, c_3, c_4 = c
    flow = expm(0.1 * np.array([[-c_1, 1.0, c_4], [-c_2, 0.0, c_3], [0.0, 0.0, 0.0]]))
    A, B = flow[:2, :2], flow[:2, 2]
    denominator = np.poly(A)
    numerator = B[0], A[0, 1] * B[1] - A[1, 1] * B[0]
    found = milling.discrete(*c, 0.1)
    np.testing.assert_allclose(found[:2], denominator[1:], rtol=1e-11)
    np.testing.assert_allclose(found[2:], numerator, rtol=1e-9)
    np.testing.assert_allclose(milling.continuous(*found, 0.1), c, rtol=2e-7, atol=1e-9)


@pytest.mark.parametrize("a", [(0.0340, -0.4567), (0.0, 0.0), (2.1, 1.1), (-2.0, 1.0)])
def test_what_no_second_order_system_has_is_not_a_number(a: tuple[float, float]) -> None:
    found = milling.continuous(*a, 1.0, 1.0, 0.01)
    assert math.isnan(found[2])


def test_regression_rows_are_those_of_the_window() -> None:
    scenario = load_scenario(QUIET)
    record, _ = scenario.observe(0)
    regression = scenario.context().regression(record)
    y = record["force_N"] - 618.608531431044
    u = record["feedrate_m_per_s"] - 0.847e-3
    np.testing.assert_array_equal(regression.rows, np.arange(1026, 1536))
    np.testing.assert_array_equal(regression.time_s, record["time_s"][1026:])
    np.testing.assert_allclose(regression.target, y[1026:], atol=1e-9)
    rows = np.column_stack((-y[1025:-1], -y[1024:-2], u[1025:-1], u[1024:-2]))
    np.testing.assert_allclose(regression.regressors, rows, atol=1e-9)


def test_records_that_are_too_short_are_refused() -> None:
    scenario = load_scenario(QUIET)
    record = scenario.observe(0)[0].slice(0, 1026)
    with pytest.raises(RecordError, match=r"1026 samples end within the settling time of 10\.24 s; at least 1027"):
        scenario.context().regression(record)


def test_models_by_other_names_are_refused() -> None:
    with pytest.raises(SpecError, match="Did you mean arx"):
        load_scenario(QUIET).plant.linear_model("arxs")


# ---- least squares in the frequency domain ----


def test_general_fit_of_a_drive_is_below_its_noise() -> None:
    data = np.genfromtxt(shared_file("oracles", "freq_ls", "frf_input.csv"), delimiter=",", names=True)
    omega, noisy, true = data["w"], data["re"] + 1j * data["im"], data["re_true"] + 1j * data["im_true"]
    fitted = fit_rational(omega, noisy, 4, 5, relative=True, iterations=4)
    error = np.abs(fitted.response(omega) / true - 1.0)
    assert float(np.sqrt(np.mean(error**2))) < 1.0e-3
    assert float(error.max()) < 0.01 < float(np.sqrt(np.mean(np.abs(noisy / true - 1.0) ** 2)))
    exact = fit_rational(omega, true, 4, 5, relative=True, iterations=4)
    assert float(np.abs(exact.response(omega) / true - 1.0).max()) < 1e-9
    spread = np.sqrt(np.diag(fitted.covariance))
    deviation = np.concatenate((fitted.denominator - exact.denominator, fitted.numerator - exact.numerator)) / spread
    assert float(np.sqrt(np.mean(deviation**2))) < 3.0
    assert fitted.degrees_of_freedom == 790


def test_linear_fit_is_that_of_the_printed_equations() -> None:
    scenario = load_scenario(RUNOUT[2])
    record, _ = scenario.observe(0)
    y = np.fft.rfft(record["force_N"][1024:])[1:15]
    u = np.fft.rfft(1e3 * record["feedrate_m_per_s"][1024:])[1:15]
    G, w = y / u, 2.0 * np.pi * np.arange(1, 15) / 5.12
    one, none = np.ones(14), np.zeros(14)
    real, imaginary = (
        np.column_stack((-w * G.imag, G.real, -one, none)),
        np.column_stack((w * G.real, G.imag, none, -w)),
    )
    X, Y = np.concatenate((real, imaginary)), np.concatenate((w**2 * G.real, w**2 * G.imag))
    c = np.linalg.lstsq(X, Y)[0]
    E = Y - X @ c
    covariance = E @ E / 24.0 * np.linalg.inv(X.T @ X)
    plant = scenario.plant
    assert isinstance(plant, TransferFunctionPlant)
    fitted = FrequencyLeastSquares(bins=BINS).identify(plant, record)
    order = [1, 0, 2, 3]
    found = np.concatenate((fitted.denominator, fitted.numerator))[order] * PER_MM
    np.testing.assert_allclose(found, c, rtol=1e-9)
    np.testing.assert_allclose(
        fitted.covariance[np.ix_(order, order)] * np.outer(PER_MM, PER_MM), covariance, rtol=1e-7
    )
    np.testing.assert_allclose(
        fitted.half_widths()[order] * PER_MM, 2.0638986 * np.sqrt(np.diag(covariance)), rtol=1e-7
    )


def test_covariance_of_the_discrete_parameters_is_propagated() -> None:
    scenario = load_scenario(RUNOUT[0])
    record, _ = scenario.observe(0)
    plant = scenario.plant
    assert isinstance(plant, TransferFunctionPlant)
    estimator = FrequencyLeastSquares(bins=BINS)
    fitted = estimator.identify(plant, record)
    at = np.concatenate((fitted.denominator, fitted.numerator))
    small = 1e-6 * fitted.covariance
    draws = np.random.default_rng(0).multivariate_normal(at, small, 4000, method="cholesky")
    values = np.array([milling.discrete(p[1], p[0], p[2], p[3], 0.01) for p in draws])
    claimed = estimator.fit(scenario.context(), record).covariance
    assert claimed is not None
    np.testing.assert_allclose(np.std(values, axis=0) / 1e-3, np.sqrt(np.diag(claimed)), rtol=0.05)
    np.testing.assert_array_equal(claimed, claimed.T)


def test_jacobian_is_exact() -> None:
    found = jacobian(lambda p: np.array([p[0] ** 2 * p[1], np.sin(p[1])]), np.array([3.0, 0.0]))
    np.testing.assert_allclose(found, [[0.0, 9.0], [0.0, 1.0]], rtol=1e-9, atol=1e-9)


def contaminated(scenario: Scenario, bins: tuple[int, ...]) -> Record:
    """Return the linear plant's record with a disturbance of whole periods, hence in those bins alone."""
    record, _ = scenario.observe(0)
    columns = {name: np.array(values) for name, values in record.items()}
    for n in bins:
        columns["force_N"] += 20.0 * np.sin(2.0 * np.pi * n / 5.12 * columns["time_s"])
    return Record(columns)


def test_bins_with_a_disturbance_can_be_deleted() -> None:
    scenario = changed(load_scenario(QUIET), linearised=True, fundamental_rad_per_s=2.0 * math.pi / 5.12)
    record, c = contaminated(scenario, (3, 4)), np.array(C) * PER_MM
    worst = {}
    for label, arguments in {
        "all": {"bins": BINS},
        "without": {"bins": BINS, "deleted_bins": (3, 4)},
        "own choice": {"deleted_bins": (3, 4)},
        "bins beyond the disturbance": {"bins": range(5, 15)},
    }.items():
        result = FrequencyLeastSquares(**arguments).fit(scenario.context(), record)  # type: ignore[arg-type]
        worst[label] = float(np.abs(continuous(scenario, result) / c - 1.0).max())
    assert worst.pop("all") > 0.05
    assert max(worst.values()) < 1e-5


def white(random: np.random.Generator, n: int) -> ComplexArray:
    return np.asarray(random.standard_normal(n) + 1j * random.standard_normal(n), dtype=np.complex128)


def test_relative_weighting_trusts_weak_bins_as_much_as_strong_ones() -> None:
    omega = np.linspace(0.5, 20.0, 60)
    s = np.asarray(1j * omega, dtype=np.complex128)
    true = np.asarray((3.0 + 2.0 * s) / (s**2 + s + 9.0), dtype=np.complex128)
    random = np.random.default_rng(3)
    errors: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(60):
        noisy = true * (1.0 + 0.02 * white(random, 60))
        for relative, found in errors.items():
            fitted = fit_rational(omega, noisy, 1, 2, relative=relative, iterations=5)
            found.append(float(np.mean(np.abs(fitted.response(omega) / true - 1.0) ** 2)))
    assert np.mean(errors[True]) < 0.8 * np.mean(errors[False])


def test_iterations_remove_the_weight_of_high_frequencies() -> None:
    omega = np.linspace(0.5, 60.0, 200)
    s = np.asarray(1j * omega, dtype=np.complex128)
    true = np.asarray(9.0 / (s**2 + 0.6 * s + 9.0), dtype=np.complex128)
    random = np.random.default_rng(5)
    errors: dict[int, list[float]] = {0: [], 6: []}
    for _ in range(20):
        noisy = true + 3e-3 * white(random, 200)
        for iterations, found in errors.items():
            found.append(float(fit_rational(omega, noisy, 0, 2, iterations=iterations).denominator[0]) - 9.0)
    assert abs(np.mean(errors[6])) < 0.01
    assert abs(np.mean(errors[0])) > 0.05


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bins": (1, 2)}, "2 frequencies for 4 coefficients; more than 2 are needed"),
        ({"bins": (1, 2, 300)}, "bin 300 cannot be used; allowed: 1 to 255"),
        ({"bins": (0, 1, 2)}, "bin 0 cannot be used"),
        ({"bins": BINS, "deleted_bins": BINS}, "0 frequencies for 4 coefficients"),
        ({"iterations": -1}, "iterations: -1 is outside"),
    ],
)
def test_bins_that_cannot_be_used_are_refused(arguments: dict[str, Any], message: str) -> None:
    scenario = load_scenario(QUIET)
    with pytest.raises(SpecError, match=message):
        FrequencyLeastSquares(**arguments).fit(scenario.context(), scenario.observe(0)[0])


def test_orders_that_cannot_be_identified_are_refused() -> None:
    omega = np.linspace(0.1, 3.0, 50)
    with pytest.raises(SpecError, match="does not identify 3 poles and 2 zeros"):
        fit_rational(omega, np.asarray(1.0 / (1.0 + 1j * omega), dtype=np.complex128), 2, 3)
    with pytest.raises(SpecError, match="relative errors"):
        fit_rational(omega, np.zeros(50, dtype=np.complex128), 0, 1, relative=True)


def test_drives_without_a_transfer_function_are_skipped() -> None:
    context = load_scenario("ShakerControl-v0").context()
    assert FrequencyLeastSquares().skip(context) == "the plant offers no transfer function between measured signals"
    assert FrequencyLeastSquares().skip(load_scenario(QUIET).context()) is None
