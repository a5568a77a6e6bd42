"""Turkay and Ulsoy (1988): time against frequency domain, tables 2 and 3 and the figures that they rest on.

Rows are in the paper's units: b in N s/mm, c_3 in N/(mm s), c_4 in N/mm.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError
from fdbench.estimator import Estimate, estimators
from fdbench.motions.schroeder_multisine import SchroederMultisine
from fdbench.plants.slot_milling import SlotMilling
from fdbench.record import Record
from fdbench.reproduce._row import Parts, Row
from fdbench.scenario import Scenario, load_scenario

FloatArray = NDArray[np.float64]
Four = tuple[float, float, float, float]

PAPER = "Turkay, Ulsoy 1988"
NAMES = ("a_1", "a_2", "b_0", "b_1")
COEFFICIENTS = ("c_1", "c_2", "c_3", "c_4")
PER_MM = np.array([1.0, 1.0, 1e-3, 1e-3])
TIME, FREQUENCY = "least_squares", "frequency_least_squares"
WINDOW = slice(1024, 1536)


class Column(NamedTuple):
    """One column of tables 2 and 3: as printed, and as a correct implementation has it."""

    title: str
    scenario: str
    table_2: Four
    table_2_target: Four
    table_3: Four
    table_3_target: Four
    table_3_discrete: Four
    b_0_errors: tuple[float, float] | None = None  # of both methods, in percent


COLUMNS = (
    Column(
        "d = 0",
        "SlotMilling-v0",
        (-1.974, 0.975, 17.82, -17.635),
        (-1.9745, 0.9751, 17.870, -17.689),
        (3.222, 8.964, 4675.320, 1757.230),
        (3.317, 9.107, 4893.6, 1765.3),
        (-1.967, 0.968, 17.521, -17.061),
    ),
    Column(
        "d = 50 sin 240.86 t",
        "SlotMillingRunout575Rpm50N-v0",
        (0.037, -0.454, -600.044, 704.770),
        (0.0340, -0.4567, -612.97, 713.28),
        (3.180, 8.789, 4527.638, 1758.570),
        (3.306, 9.057, 4863.2, 1767.4),
        (-1.968, 0.969, 17.530, -17.085),
        (3594.0, 0.46),
    ),
    Column(
        "d = 25 sin 240.86 t",
        "SlotMillingRunout575Rpm25N-v0",
        (-0.157, -0.649, -159.573, 214.550),
        (-0.1595, -0.6504, -165.29, 218.15),
        (3.201, 8.876, 4601.493, 1757.907),
        (3.311, 9.082, 4878.5, 1766.3),
        (-1.968, 0.968, 17.526, -17.073),
        (1042.0, 0.40),
    ),
    Column(
        "d = 50 sin 41.89 t",
        "SlotMillingRunout200Rpm50N-v0",
        (-1.855, 0.956, -95.808, 109.750),
        (-1.8541, 0.9554, -96.052, 109.784),
        (2.499, 6.068, 2163.432, 1781.822),
        (3.007, 7.923, 4121.2, 1821.6),
        (-1.975, 0.975, 17.703, -17.489),
        (648.0, 3.45),
    ),
    Column(
        "d = 25 sin 41.89 t",
        "SlotMillingRunout200Rpm25N-v0",
        (-1.876, 0.922, -32.752, 39.898),
        (-1.8753, 0.9214, -32.549, 39.632),
        (2.853, 7.458, 3397.487, 1771.791),
        (3.175, 8.508, 4529.1, 1793.8),
        (-1.971, 0.972, 17.634, -17.299),
        (286.0, 1.92),
    ),
)
PHASES = (
    "rests on phases that the paper does not give, of its multisine and of the run-out at the start of the window; "
    "the target is this signal's"
)
INTERVALS = "printed eqs. (23) and (25) are wrong; the target is t(0.975) times the standard error"


def _must(item: str, value: float, target: float, tolerance: float, paper: float | None = None) -> Row:
    return Row(paper=PAPER, item=item, paper_value=paper, value=value, target=target, tolerance=tolerance, kind="must")


def _ranking(item: str, holds: bool) -> Row:
    return Row(paper=PAPER, item=item, paper_value=1.0, value=float(holds), target=1.0, tolerance=0.0, kind="ranking")


def _shown(item: str, value: float, target: float, tolerance: float, paper: float | None, reason: str) -> Row:
    return Row(
        paper=PAPER,
        item=item,
        paper_value=paper,
        value=value,
        target=target,
        tolerance=tolerance,
        kind="not reproducible",
        reason=reason,
    )


def _plant(scenario: Scenario) -> SlotMilling:
    if not isinstance(scenario.plant, SlotMilling):
        raise SpecError(f"{scenario.id}: plant: slot_milling is expected.")
    return scenario.plant


def estimate(scenario: Scenario, name: str, record: Record | None = None) -> Estimate:
    """Return what an estimator says, with the scenario's hyperparameters."""
    estimator = estimators.get(name)(**scenario.estimation.hyperparameters.get(name, {}))
    return estimator.fit(scenario.context(), scenario.observe(0)[0] if record is None else record)


def discrete(result: Estimate) -> FloatArray:
    """Return a_1, a_2, b_0, b_1 in the paper's units."""
    return np.asarray(np.array([result.parameters[name] for name in NAMES]) * PER_MM)


def continuous(scenario: Scenario, parameters: Mapping[str, float]) -> FloatArray:
    """Return c_1 ... c_4 in the paper's units."""
    period = scenario.setup.timing.sampling_time_s
    values = scenario.linear_model.physical_parameters(parameters, period)
    return np.asarray(np.array([values[name] for name in COEFFICIENTS]) * PER_MM)


def changed(scenario: Scenario, motion: Mapping[str, float] | None = None, **plant: bool) -> Scenario:
    """Return a scenario with fields of its motion and of its plant replaced."""
    moved = scenario.motion if motion is None else dataclasses.replace(scenario.motion, **motion)  # type: ignore[type-var]
    return dataclasses.replace(scenario, motion=moved, plant=dataclasses.replace(_plant(scenario), **plant))


def half_widths(scenario: Scenario, result: Estimate, degrees_of_freedom: int) -> tuple[FloatArray, FloatArray]:
    """Return half the widths of 95 % t intervals, of a_1 ... b_1 and, to first order, of c_1 ... c_4."""
    from scipy.special import stdtrit

    covariance = np.asarray(result.covariance)
    at = np.array([result.parameters[name] for name in NAMES])
    slope = np.empty((4, 4))
    for column in range(4):
        step = np.zeros(4)
        step[column] = 1e-7 * abs(at[column])
        above, below = (
            continuous(scenario, dict(zip(NAMES, (at + sign * step).tolist(), strict=True))) for sign in (1.0, -1.0)
        )
        slope[:, column] = (above - below) / (2.0 * step[column])
    t = float(stdtrit(degrees_of_freedom, 0.975))
    return t * np.sqrt(np.diag(covariance)) * PER_MM, t * np.sqrt(np.diag(slope @ covariance @ slope.T))


def constants(scenario: Scenario) -> Iterator[Row]:
    """TU1 and TU2: what follows from table 1, and the multisine."""
    plant, period = _plant(scenario), scenario.setup.timing.sampling_time_s
    yield _must("gain g, N s/mm", 1e-3 * plant.gain_N_s_per_m, 533.1573, 533.1573e-6)
    yield _must("steady force F_0, N", plant.steady_force_N, 618.6085, 618.6085e-6)
    truth = scenario.linear_model.nominal_parameters(period)
    exact = continuous(scenario, truth)
    for name, value, target in zip(COEFFICIENTS, exact.tolist(), (3.3, 9.0, 4798.416, 1759.419), strict=True):
        yield _must(f"table 3, exact {name}", value, target, 1e-6 * target, target)
    targets, printed = (-1.966653, 0.967539, 17.541743, -17.069768), (-1.967, 0.968, 17.542, -17.070)
    found = np.array([truth[name] for name in NAMES]) * PER_MM
    for name, value, target, paper in zip(NAMES, found.tolist(), targets, printed, strict=True):
        yield _must(f"table 2, exact {name}", value, target, 1e-6, paper)
    c_1, c_2, c_3, c_4 = exact.tolist()
    root = math.sqrt(c_2 - 0.25 * c_1**2)
    E, C, S = math.exp(-0.5 * c_1 * period), math.cos(root * period), math.sin(root * period)
    literal = c_3 / c_2 * (1.0 - E * C + 0.5 * c_1 / root * S) + c_4 / root * E * S
    yield _must("eq. (13) as printed: b_0, which its bracket doubles", literal, 34.99, 0.005)
    for scale, spread, low, high in ((1.0, 0.5, -0.913, 0.772), (0.2, 0.1, -0.1825, 0.1544)):
        multisine = SchroederMultisine(
            mean_velocity_m_per_s=0.0,
            scale_m_per_s=1e-3 * scale,
            harmonics=16,
            fundamental_rad_per_s=1.2275,
            first_phase_rad=0.0,
        )
        feedrate = 1e3 * multisine.reference(period, 1536)[:, 1]
        for item, value, target in (
            ("root mean square", float(np.sqrt(np.mean(feedrate**2))), spread),
            ("least", float(feedrate.min()), low),
            ("largest", float(feedrate.max()), high),
        ):
            yield _must(f"multisine, s = {scale:g} mm/s: {item}, mm/s", value, target, 0.002 * abs(target))


def table_2(results: Mapping[str, FloatArray]) -> Iterator[Row]:
    """TU4: least squares in the time domain fails under run-out exactly as the paper's does."""
    close = True
    for column in COLUMNS:
        found = results[column.scenario]
        for n, name in enumerate(NAMES):
            target = column.table_2_target[n]
            tolerance = 0.002 if n < 2 else 0.01 * abs(target)
            yield _must(f"table 2, {column.title}: {name}", float(found[n]), target, tolerance, column.table_2[n])
        error = np.abs(found - column.table_2)
        close &= bool((error[:2] <= 0.005).all() and (error[2:] <= 0.04 * np.abs(column.table_2[2:])).all())
    yield _ranking("table 2: all 20 entries as printed, to 0.005 in a and 4 % in b", close)


def table_3(results: Mapping[str, FloatArray], exact: FloatArray) -> Iterator[Row]:
    """Least squares in the frequency domain: single entries are shown, the effect of the run-out has to be there."""
    scenario = load_scenario(COLUMNS[0].scenario)
    found: dict[str, FloatArray] = {}
    for column in COLUMNS:
        ours = results[column.scenario]
        parameters = dict(zip(NAMES, (ours / PER_MM).tolist(), strict=True))
        found[column.scenario] = continuous(scenario, parameters)
        for n, name in enumerate(COEFFICIENTS):
            value, target = float(found[column.scenario][n]), column.table_3_target[n]
            item = f"table 3, {column.title}: {name}"
            yield _shown(item, value, target, 5e-4 * target, column.table_3[n], PHASES)
        for n, name in enumerate(NAMES):
            paper = column.table_3_discrete[n]
            item = f"table 3, {column.title}: {name} by eq. (13)"
            yield _shown(item, float(ours[n]), paper, 0.04 * abs(paper), paper, PHASES)
    fast_50, fast_25, slow_50, slow_25 = (found[column.scenario] - found["SlotMilling-v0"] for column in COLUMNS[1:])
    shifts = (fast_50, fast_25, slow_50, slow_25)
    for column, shift in zip(COLUMNS[1:], shifts, strict=True):
        yield _ranking(
            f"table 3, {column.title}: c_1, c_2, c_3 fall, c_4 rises", bool((shift * [-1, -1, -1, 1] > 0).all())
        )
    for item, large, small in (("240.86", fast_50, fast_25), ("41.89", slow_50, slow_25)):
        halves = bool((np.abs(small / large - 0.5) <= 0.1).all())
        yield _ranking(f"table 3: 25 N does half the harm of 50 N, at {item} rad/s", halves)
    hurts_less = bool((np.abs(fast_50) < 0.2 * np.abs(slow_50)).all())
    yield _ranking("table 3: 240.86 rad/s does less than a fifth of the harm of 41.89 rad/s", hurts_less)
    b = np.array([results[column.scenario][2:] for column in COLUMNS])
    within = bool((np.abs(b / exact[2:] - 1.0) <= 0.04).all())
    yield _ranking("table 3: b_0 and b_1 by eq. (13) are within 4 % in every column", within)
    worst = max(abs(float(values[2]) / 4798.416 - 1.0) for values in found.values())
    yield _ranking("table 3: c_3 errs by more than 10 % in the worst column", worst > 0.10)


def contrast(time: Mapping[str, FloatArray], frequency: Mapping[str, FloatArray], exact: FloatArray) -> Iterator[Row]:
    """TU6: error of b_0 by both methods."""
    for column in COLUMNS:
        if column.b_0_errors is None:
            continue
        errors = [100.0 * abs(float(found[column.scenario][2] / exact[2]) - 1.0) for found in (time, frequency)]
        paper = [100.0 * abs(entry / 17.542 - 1.0) for entry in (column.table_2[2], column.table_3_discrete[2])]
        for label, error, target, tolerance, printed in zip(
            ("time", "frequency"), errors, column.b_0_errors, (0.01 * column.b_0_errors[0], 0.05), paper, strict=True
        ):
            yield _must(f"error of b_0, {label} domain, {column.title}, %", error, target, tolerance, printed)
        yield _ranking(f"error of b_0, {column.title}: at least 50 times smaller", errors[0] >= 50.0 * errors[1])


def controls(scenario: Scenario, exact: FloatArray) -> Iterator[Row]:
    """TU3 and TU5: what is left without the power law, between-sample motion, leakage, or with a window."""
    held = discrete(estimate(changed(scenario, linearised=True, hold_input=True), TIME))
    for name, value, target in zip(NAMES, held.tolist(), exact.tolist(), strict=True):
        yield _must(f"time domain, linear, input held: {name}", value, target, 1e-9 * abs(target))
    linear = changed(scenario, linearised=True)
    targets = (-1.9745, 0.9751, 17.8415, -17.6622)
    for n, value in enumerate(discrete(estimate(linear, TIME)).tolist()):
        tolerance = 0.002 if n < 2 else 0.01 * abs(targets[n])
        yield _must(f"time domain, linear, input varies: {NAMES[n]}", value, targets[n], tolerance)
    periodic = changed(scenario, {"fundamental_rad_per_s": 2.0 * math.pi / 5.12}, linearised=True)
    for title, case, values, relative in (
        ("w_0 = 1.2275", linear, (3.300, 9.001, 4800.1, 1759.41), 2e-4),
        ("w_0 = 2 pi/5.12", periodic, (3.3, 9.0, 4798.415, 1759.419), 1e-5),
    ):
        found = continuous(case, estimate(case, FREQUENCY).parameters)
        for name, value, target in zip(COEFFICIENTS, found.tolist(), values, strict=True):
            yield _must(f"frequency domain, linear, {title}: {name}", value, target, relative * target)
    runout = load_scenario(COLUMNS[1].scenario)
    for scale, target in ((0.19, -669.0), (0.21, -563.0)):
        b_0 = float(discrete(estimate(changed(runout, {"scale_m_per_s": 1e-3 * scale}), TIME))[2])
        yield _must(f"table 2, {COLUMNS[1].title}, s = {scale:g} mm/s: b_0", b_0, target, 0.01 * abs(target), -600.044)
    yield _must("frequency domain under a Hann window: c_1", _with_hann_window(scenario), 0.50, 0.01)


def _with_hann_window(scenario: Scenario) -> float:
    """Return c_1 where both signals carry a Hann window, which mixes neighbouring bins."""
    record, plant = scenario.observe(0)[0], _plant(scenario)
    columns = {name: np.array(values) for name, values in record.items()}
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(512) / 512)
    for name, mean in (("feedrate_m_per_s", plant.operating_feedrate_m_per_s), ("force_N", plant.steady_force_N)):
        columns[name][WINDOW] = mean + hann * (columns[name][WINDOW] - mean)
    return float(continuous(scenario, estimate(scenario, FREQUENCY, Record(columns)).parameters)[0])


def intervals(scenario: Scenario) -> Iterator[Row]:
    """Half widths without run-out; those of the other columns say no more."""
    time = half_widths(scenario, estimate(scenario, TIME), 510 - 4)[0]
    frequency = half_widths(scenario, estimate(scenario, FREQUENCY), 28 - 4)[1]
    for label, names, found, targets, printed in (
        ("table 2", NAMES, time, (0.00229, 0.00229, 0.0895, 0.1038), (0.057, 0.014, 0.118, 0.100)),
        ("table 3", COEFFICIENTS, frequency, (0.198, 0.528, 410.0, 10.1), (0.010, 0.028, 9.803, 54.978)),
    ):
        for name, value, target, paper in zip(names, found.tolist(), targets, printed, strict=True):
            yield _shown(f"{label}, d = 0: half width of {name}", value, target, 0.03 * target, paper, INTERVALS)


def parts() -> Parts:
    """Return the parts of the paper whose figures stand beside ours."""

    @cache
    def scenario_of(name: str) -> Scenario:
        return load_scenario(name)

    @cache
    def found(method: str) -> dict[str, FloatArray]:
        return {column.scenario: discrete(estimate(scenario_of(column.scenario), method)) for column in COLUMNS}

    @cache
    def exact() -> FloatArray:
        quiet = scenario_of(COLUMNS[0].scenario)
        truth = quiet.linear_model.nominal_parameters(quiet.setup.timing.sampling_time_s)
        return np.asarray(np.array([truth[name] for name in NAMES]) * PER_MM)

    return {
        "constants": lambda: constants(scenario_of(COLUMNS[0].scenario)),
        "table 2": lambda: table_2(found(TIME)),
        "table 3": lambda: table_3(found(FREQUENCY), exact()),
        "error of b_0": lambda: contrast(found(TIME), found(FREQUENCY), exact()),
        "controls": lambda: controls(scenario_of(COLUMNS[0].scenario), exact()),
        "intervals": lambda: intervals(scenario_of(COLUMNS[0].scenario)),
    }
