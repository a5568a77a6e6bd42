"""McPherson (2024): bias of least squares under a periodic force, and the kernel methods that remove it."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fdbench.estimator import Estimate, estimators
from fdbench.metrics import Outcome, metrics
from fdbench.plants._friction_curve import FrictionLine
from fdbench.plants._velocity_loop import VelocityLoopModel
from fdbench.reproduce._row import Parts, Row
from fdbench.scenario import Scenario, load_scenario

PAPER = "McPherson 2024"
SEEDS = 5
DISTURBANCE_N_PER_M_PER_S2 = 20.0  # mass of the shaker scenarios
HELD = {"hyperparameters": "given"}


def fit(scenario: Scenario, name: str, seed: int, **changes: Any) -> tuple[Estimate, Outcome]:
    """Return an estimate with the scenario's hyperparameters, held as in the thesis, and its outcome."""
    record, truth = scenario.observe(seed)
    context = scenario.context()
    held = HELD if name == "pl_lssvm" else {}
    arguments: Mapping[str, Any] = {**scenario.estimation.hyperparameters.get(name, {}), **held, **changes}
    estimate = estimators.get(name)(**arguments).fit(context, record)
    regression = context.regression(record)
    outcome = Outcome(
        scenario=scenario, record=record, regression=regression, truth=truth, estimate=estimate, seconds=0.0
    )
    return estimate, outcome


def beside_pl_lssvm(scenario: Scenario, name: str, seed: int) -> tuple[Estimate, Outcome]:
    """Return what `fit` returns; KRLS-T holds the linear parameters of PL-LSSVM, as in the thesis."""
    if name != "krls_t":
        return fit(scenario, name, seed)
    identified = estimators.get("pl_lssvm")(**HELD).fit(scenario.context(), scenario.observe(seed)[0])
    return fit(scenario, name, seed, linear_parameters=identified.parameters)


def mean_beta(scenario: Scenario, name: str, seeds: int = SEEDS, **changes: Any) -> np.ndarray:
    """Return the mean over seeds of beta_1 and beta_2."""
    rows = []
    for seed in range(seeds):
        parameters = fit(scenario, name, seed, **changes)[0].parameters
        rows.append((parameters["beta_1"], parameters["beta_2"]))
    return np.asarray(np.mean(rows, axis=0))


def with_amplitude(scenario: Scenario, acceleration: float) -> Scenario:
    """Return a shaker scenario with another amplitude, in m/s^2 of table acceleration."""
    force = acceleration * DISTURBANCE_N_PER_M_PER_S2
    effects = tuple(
        effect.changed(**{type(effect).amplitude: force}) if effect.disturbance else effect
        for effect in scenario.reality.effects
    )
    return dataclasses.replace(scenario, reality=dataclasses.replace(scenario.reality, effects=effects))


def with_mass(scenario: Scenario, mass_kg: float) -> Scenario:
    """Return a milling scenario with another equivalent mass, gain and friction in proportion."""
    plant: Any = scenario.plant
    ratio = mass_kg / plant.motor.mass_kg
    motor = dataclasses.replace(
        plant.motor, mass_kg=mass_kg, viscous_friction_N_s_per_m=plant.motor.viscous_friction_N_s_per_m * ratio
    )
    controller = dataclasses.replace(plant.controller, gain_N_s_per_m=plant.controller.gain_N_s_per_m * ratio)
    return dataclasses.replace(scenario, plant=dataclasses.replace(plant, motor=motor, controller=controller))


def _must(item: str, paper: float | None, value: float, target: float, tolerance: float, reason: str = "") -> Row:
    return Row(
        paper=PAPER, item=item, paper_value=paper, value=float(value), target=target, tolerance=tolerance,
        kind="must", reason=reason,
    )  # fmt: skip


def conversions() -> Iterator[Row]:
    """MP1: discrete to continuous."""
    for label, beta, pole, gain in (
        ("shaker", (0.8335, 0.1632), -1.1007, 278.01),
        ("milling", (0.3699, 0.6292), -0.299835, 123.23),
    ):
        line = FrictionLine(viscous_N_s_per_m=0.0, coulomb_N=0.0, offset_N=0.0)
        model = VelocityLoopModel(mass_kg=1.0, line=line, gain_N_s_per_m=1.0)
        physical = model.physical_parameters({"beta_1": beta[0], "beta_2": beta[1]}, 1.0 / 333.0)
        found_gain = 1.0 / physical["mass_kg"]
        found_pole = -physical["viscous_friction_N_s_per_m"] / physical["mass_kg"]
        yield _must(f"{label}: pole p, 1/s", None, found_pole, pole, 1e-4 * abs(pole))
        yield _must(f"{label}: gain K_v, 1/s", None, found_gain, gain, 1e-4 * gain)


def shaker() -> Iterator[Row]:
    """Section 3.4 of the digest: bias of LS, none of PL-LSSVM, KRLS-T ahead of LS at 55 Hz."""
    control = load_scenario("ShakerControl-v0")
    ls_0, pl_0 = mean_beta(control, "least_squares"), mean_beta(control, "pl_lssvm")
    yield _must("control, LS: beta_1", 0.8338, ls_0[0], 0.83290, 3e-4, "target: one standard deviation over seeds")
    yield _must(
        "control, PL-LSSVM: beta_1", 0.8335, pl_0[0], 0.83295, 3e-4, "target: one standard deviation over seeds"
    )
    cases = (
        ("constant", "ShakerConstant-v0", 0.06, -0.0023, 2.5e-4, 2e-4, -0.0021),
        ("sweep", "ShakerSweep-v0", 0.06, -0.0016, 2.5e-4, 2e-4, -0.0011),
        ("constant", "ShakerConstant-v0", 0.3, -0.046, 0.002, 1e-3, None),
        ("sweep", "ShakerSweep-v0", 0.3, -0.035, 0.002, 2e-4, None),
    )
    for label, name, amplitude, shift, shift_tolerance, pl_tolerance, paper in cases:
        scenario = with_amplitude(load_scenario(name), amplitude)
        item = f"{label}, A {amplitude} m/s^2"
        ls = mean_beta(scenario, "least_squares") - ls_0
        pl = mean_beta(scenario, "pl_lssvm") - pl_0
        yield _must(f"{item}, LS: shift of beta_1 from control", paper, ls[0], shift, shift_tolerance)
        yield _must(f"{item}, PL-LSSVM: shift of beta_1 from control", None, pl[0], 0.0, pl_tolerance)
    wrong = mean_beta(with_amplitude(load_scenario("ShakerConstant-v0"), 0.3), "pl_lssvm", 2, period_s=0.019)
    near = mean_beta(with_amplitude(load_scenario("ShakerConstant-v0"), 0.3), "pl_lssvm", 2, period_s=0.0184)
    yield _ranking("PL-LSSVM with a period 4.5 % off is as biased as LS", wrong[0] - ls_0[0] < -0.04)
    yield _ranking("PL-LSSVM with a period 1.2 % off still works", abs(near[0] - pl_0[0]) < 0.005)


def _ranking(item: str, holds: bool) -> Row:
    return Row(
        paper=PAPER, item=item, paper_value=None, value=float(holds), target=1.0, tolerance=0.0, kind="ranking"
    )  # fmt: skip


def prediction() -> Iterator[Row]:
    """One-step errors and spectra on the constant shaker."""
    scenario = load_scenario("ShakerConstant-v0")
    rms: dict[str, list[float]] = {}
    peak: dict[str, list[float]] = {}
    disturbance: dict[str, list[float]] = {}
    for seed in range(SEEDS):
        for name in ("least_squares", "pl_lssvm", "krls_t"):
            estimate, outcome = beside_pl_lssvm(scenario, name, seed)
            error = outcome.regression.target - np.asarray(estimate.output)
            rms.setdefault(name, []).append(float(np.sqrt(np.mean(error**2))))
            peak.setdefault(name, []).append(metrics.get("psd_residual_at_disturbance")().score(outcome))
            disturbance.setdefault(name, []).append(metrics.get("disturbance_error")().score(outcome))
    mean = {name: float(np.mean(values)) for name, values in rms.items()}
    yield _must("constant, LS: RMS prediction error, m/s", 1e-4, mean["least_squares"], 1.0e-4, 0.05e-4)
    yield _must("constant, PL-LSSVM: RMS prediction error, m/s", None, mean["pl_lssvm"], 2.2e-5, 0.2e-5)
    yield _must("constant, KRLS-T: RMS prediction error, m/s", None, mean["krls_t"], 2.45e-5, 0.2e-5)
    yield _ranking("prediction error PL-LSSVM < KRLS-T < LS", mean["pl_lssvm"] < mean["krls_t"] < mean["least_squares"])
    gain = float(np.mean(peak["least_squares"])) - float(np.mean(peak["krls_t"]))
    yield _must("constant: KRLS-T below LS at 55 Hz, dB", None, gain, 24.0, 3.0)
    yield _must("constant, PL-LSSVM: disturbance error, %", None, float(np.mean(disturbance["pl_lssvm"])), 7.5, 4.5)
    yield Row(
        paper=PAPER, item="constant, KRLS-T: one-step disturbance error, %", paper_value=None,
        value=float(np.mean(disturbance["krls_t"])), target=8.8, tolerance=2.5, kind="must",
        reason="the corrected figures are 7.6 to 10 %",
    )  # fmt: skip


def milling() -> Iterator[Row]:
    """Section 3.5 of the digest."""
    air = load_scenario("MillingAir-v0")
    air_ls = mean_beta(air, "least_squares", 2)
    yield _must("air, LS: beta_1", None, air_ls[0], 0.3698, 0.002)
    cutting = load_scenario("MillingUpDown-v0")
    for mass, ls_1, pl_1 in ((3000.0, 0.4309, 0.3737), (1000.0, 0.6432, 0.3834), (300.0, 0.8816, 0.4321)):
        scenario = with_mass(cutting, mass)
        ls, pl = mean_beta(scenario, "least_squares", 2)[0], mean_beta(scenario, "pl_lssvm", 2)[0]
        yield _must(f"{mass:.0f} kg, LS: beta_1", None, ls, ls_1, 0.1 * (ls_1 - 0.3698))
        yield _must(f"{mass:.0f} kg, PL-LSSVM: beta_1", None, pl, pl_1, 0.1 * (pl_1 - 0.3698))
        yield _ranking(f"{mass:.0f} kg: PL-LSSVM at least 6 x less biased than LS", (ls - 0.3698) > 6 * (pl - 0.3698))
    error = [
        metrics.get("disturbance_error")().score(beside_pl_lssvm(cutting, name, 0)[1])
        for name in ("pl_lssvm", "krls_t")
    ]
    yield _must("1000 kg, PL-LSSVM: AC disturbance error, %", None, error[0], 11.0, 2.0)
    yield _must("1000 kg, KRLS-T: AC one-step disturbance error, %", None, error[1], 19.5, 3.0)
    yield Row(
        paper=PAPER, item="trial 2, LS: beta_2", paper_value=1.2666,
        value=float(mean_beta(cutting, "least_squares", 1)[1]), target=1.2666, tolerance=0.0, kind="not reproducible",
        reason="a stationary 50/100 Hz force drives beta_2 below 1; above 1 needs stale samples or a clock offset",
    )  # fmt: skip


def parts() -> Parts:
    """Return the parts of the thesis whose figures stand beside ours."""
    return {
        "conversions": conversions,
        "shaker, coefficients": shaker,
        "shaker, prediction": prediction,
        "milling": milling,
    }
