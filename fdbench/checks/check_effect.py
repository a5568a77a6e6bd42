"""Shared checks of effects: what every effect file must hold, whoever wrote it."""

import dataclasses
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from fdbench.checks._data_sheet import check_data_sheet
from fdbench.checks._own_record import is_named_first
from fdbench.checks._report import run_checks
from fdbench.effects import Effect, Port, effects
from fdbench.errors import FdbenchError, PluginError, raise_all
from fdbench.motions.jerk_limited_moves import JerkLimitedMoves
from fdbench.scenario import load_scenario
from fdbench.simulate.axis import Axis
from fdbench.simulate.system import FloatArray, Setup
from fdbench.specification import read
from fdbench.units import FOREIGN, UNITS

BASE_SCENARIO = "BallScrewAxis-v0"
LANES, MANY_LANES, SOME_LANES = 64, 70, (0, 5, 63, 64, 69)
DURATION_S = 0.6
MOTION = JerkLimitedMoves(
    stops_m=(0.0, 0.02, 0.015, 0.016, 0.0155),
    velocity_m_per_s=0.1,
    acceleration_m_per_s2=4.0,
    jerk_m_per_s3=200.0,
    dwell_s=0.02,
)
POINTS, ROLL_OUT = 40, 5
REFINED, FINEST, LEAST_ORDER = 4, 16, 1.8
RESOLVED, RESOLVED_M = 0.02, 5e-8
INPUT_RANGE = {  # of u, by port; what is not named here is a force
    Port.TABLE_INERTIA: 10.0,
    Port.TRANSMISSION: 1e-4,
    Port.MOTOR_ENCODER: 0.5,
    Port.TABLE_SCALE: 0.5,
    Port.LOGGING: 1.0,
}
FORCE_RANGE_N = 5000.0


class EffectBench:
    """An elastic axis on which effects are tried: the plant of a scenario, without noise, on a short motion.

    Parameters
    ----------
    kinds : sequence of Effect classes
        All are composed into one stepper and switched on one at a time.
    """

    def __init__(self, kinds: Sequence[type[Effect]]) -> None:
        self.kinds = tuple(kinds)
        scenario = load_scenario(BASE_SCENARIO)
        self.plant = scenario.plant
        self.timing = dataclasses.replace(scenario.setup.timing, duration_s=DURATION_S)
        self._axes: dict[tuple[int, int], Axis] = {}
        self._plain: dict[int, FloatArray] = {}

    def axis(self, n_lanes: int = LANES, refinement: int = 1) -> Axis:
        """Return the axis with all tried effects off; ``refinement`` divides the substep."""
        key = n_lanes, refinement
        if key not in self._axes:
            timing = dataclasses.replace(self.timing, substeps=refinement * self.timing.substeps)
            setup = Setup(timing=timing, motion=MOTION, unmodelled=tuple(kind.typical() for kind in self.kinds))
            self._axes[key] = cast(Axis, self.plant.system(setup, n_lanes))
        axis = self._axes[key]
        for number in range(len(axis.effects) - len(self.kinds), len(axis.effects)):
            axis.enable(number, False)
        return axis

    def number(self, axis: Axis, kind: type[Effect]) -> int:
        """Return the place of a tried effect among the effects of the axis."""
        return len(axis.effects) - len(self.kinds) + self.kinds.index(kind)

    def run(
        self,
        kind: type[Effect],
        values: FloatArray,
        on: bool | NDArray[np.bool_] = True,
        *,
        n_lanes: int = LANES,
        refinement: int = 1,
        seeds: Sequence[int] | None = None,
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the rows (n_samples, n_columns, n_lanes) of one episode with one effect, and which lanes diverged.

        ``values`` is an (n_parameters,) or (n_parameters, n_lanes) array.
        """
        axis = self.axis(n_lanes, refinement)
        number = self.number(axis, kind)
        axis.set_parameters(number, values)
        axis.enable(number, on)
        axis.start(range(n_lanes) if seeds is None else seeds)
        rows = axis.advance(axis.n_samples)
        return rows, axis.diverged

    def plain(self, refinement: int = 1) -> FloatArray:
        """Return the rows without any tried effect."""
        if refinement not in self._plain:
            axis = self.axis(LANES, refinement)
            axis.start(range(LANES))
            self._plain[refinement] = axis.advance(axis.n_samples)
        return self._plain[refinement]

    @cached_property
    def positions(self) -> list[int]:
        """Columns of the two positions that are read."""
        return [self.axis().columns.index(name) for name in ("motor_position_m", "table_position_m")]


@dataclass(frozen=True)
class CheckedEffect:
    """One effect on a bench."""

    cls: type[Effect]
    bench: EffectBench

    @property
    def typical(self) -> FloatArray:
        """Parameters at their typical size (n_parameters,)."""
        return np.array(self.cls.typical().values())

    def corners(self, generator: np.random.Generator, n: int) -> FloatArray:
        """Return (n_parameters, n) random points of the parameter box, two thirds of the coordinates on its faces."""
        low = np.array([item.low for item in self.cls.parameters()])[:, None]
        high = np.array([item.high for item in self.cls.parameters()])[:, None]
        share = generator.random((len(low), n))
        face = generator.integers(0, 3, share.shape)
        return np.where(face == 0, low, np.where(face == 1, high, low + share * (high - low)))

    def around(self, generator: np.random.Generator, n: int) -> FloatArray:
        """Return (n_parameters, n) random points within a factor of two of the typical size."""
        low = np.array([item.low for item in self.cls.parameters()])[:, None]
        high = np.array([item.high for item in self.cls.parameters()])[:, None]
        factor = 2.0 ** generator.uniform(-1.0, 1.0, (len(low), n))
        points: FloatArray = np.clip(self.typical[:, None] * factor, low, high)
        return points

    def calls(self, generator: np.random.Generator) -> list[tuple[np.float64, ...]]:
        """Return random arguments of the kernel, internal states as they are after a few substeps."""
        h = self.bench.timing.substep_s
        wide = INPUT_RANGE.get(self.cls.port, FORCE_RANGE_N)
        kernel, n_values = self.cls.kernel, 2 if self.cls.port.is_force else 1
        found = []
        for parameters in self.corners(generator, POINTS).T:
            states: tuple[float, ...] = (0.0,) * len(self.cls.states)
            for step in range(ROLL_OUT):
                v = generator.choice([0.0, 1e-5, 1e-2, 1.0]) * generator.uniform(-1.0, 1.0)
                leading = [(step + 0.5) * h, h, generator.uniform(-0.5, 0.5), v, generator.uniform(-wide, wide)]
                leading += [generator.random()] if self.cls.random else []
                arguments = tuple(np.float64(item) for item in (*leading, *parameters, *states))
                states = kernel(*arguments)[n_values:]
                found.append(arguments)
        return found

    def generator(self) -> np.random.Generator:
        """Return the generator of the random points, always the same."""
        return np.random.default_rng(len(self.cls.parameters()))


def declares_what_the_kernel_takes(case: CheckedEffect) -> None:
    """Kernel arguments are the declared symbols; amplitudes are parameters that may be zero."""
    cls, misses = case.cls, []
    try:
        cls.check_signature()
    except PluginError as error:
        misses.append(str(error))
    frozen = dataclasses.is_dataclass(cls) and cls.__dataclass_params__.frozen
    if not (frozen and getattr(cls, "__final__", False)):
        misses.append("the class must be @final and a @dataclass(frozen=True, kw_only=True).")
    parameters = {item.name: item for item in cls.parameters()}
    for name in (cls.amplitude, *cls.further_amplitudes):
        if name not in parameters:
            misses.append(f"the amplitude {name} is not one of the parameters {', '.join(parameters)}.")
        elif not parameters[name].low <= 0.0 <= parameters[name].high:
            misses.append(f"the amplitude {name} cannot be zero within its bounds.")
    unknown = {*cls.confusable_with, cls.same_signal_as} - {"", *effects.names()}
    if unknown:
        misses.append(f"confusable_with or same_signal_as names {', '.join(sorted(unknown))}, which is no effect.")
    raise_all(misses)


def has_bounds_around_its_typical_size(case: CheckedEffect) -> None:
    """Bounds are finite, and hold the typical size and what the diagnosis tries."""
    misses = []
    for item in case.cls.parameters():
        if not (math.isfinite(item.low) and math.isfinite(item.high)):
            misses.append(f"{item.name} has no finite bounds.")
        misses += [
            f"{item.name}: {value:g} is outside its bounds [{item.low:g}, {item.high:g}]."
            for value in (item.typical, *item.grid)
            if not item.low <= value <= item.high
        ]
    raise_all(misses)


def carries_units(case: CheckedEffect) -> None:
    """Parameter names end in an SI unit, or name a pure number."""
    words = {word for unit in [*UNITS, *FOREIGN] for word in unit.replace("/", "_").split("_")} - {"1"}
    raise_all(
        f"{item.name} looks as if it had a unit, but none of the list in fdbench/units.py."
        for item in case.cls.parameters()
        if not item.unit and words & set(item.name.split("_")[1:])
    )


def is_documented(case: CheckedEffect) -> None:
    """Equation, source and a worked example, which is right, are in the docstring."""
    check_data_sheet(case.cls, (".. math::", "Source:", ">>> "))


def survives_toml(case: CheckedEffect) -> None:
    """Written as TOML and read again it is the same; a value outside the bounds is refused."""
    effect = case.cls.typical()
    items = {item.name: getattr(effect, item.name) for item in case.cls.parameters()}
    text = "".join(f"{name} = {value!r}\n" for name, value in items.items())
    if read(case.cls, tomllib.loads(text), case.cls.name) != effect:
        raise PluginError(f"the effect is not the same after a round trip through TOML:\n{text}")
    raise_all(
        f"{item.name} = {outside!r} is accepted; call super().__post_init__()."
        for item in case.cls.parameters()
        for outside in (math.nextafter(item.low, -math.inf), math.nextafter(item.high, math.inf), math.nan)
        if _is_accepted(case.cls, item.name, outside)
    )


def _is_accepted(cls: type[Effect], name: str, value: float) -> bool:
    try:
        cls.typical(**{name: value})
    except FdbenchError:
        return False
    return True


def is_compiled_faithfully(case: CheckedEffect) -> None:
    """Compiled and plain Python agree to the last bit or its neighbour, at random points of the parameter box."""
    with np.errstate(all="ignore"):
        for arguments in case.calls(case.generator()):
            compiled = np.array(case.cls.kernel(*arguments))
            plain = np.array(case.cls.kernel.py_func(*arguments))
            if not np.all((np.abs(compiled - plain) <= np.spacing(np.abs(plain))) | (compiled == plain)):
                raise PluginError(f"compiled {compiled} and plain Python {plain} differ for {arguments}.")


def returns_finite_values(case: CheckedEffect) -> None:
    """Kernel values are finite everywhere in the parameter box, and slopes are not negative."""
    for arguments in case.calls(case.generator()):
        result = case.cls.kernel(*arguments)
        if not np.isfinite(result).all():
            raise PluginError(f"the kernel returns {result} for {arguments}.")
        if case.cls.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE) and result[1] < 0.0:
            raise PluginError(f"the slope {result[1]} is negative for {arguments}.")


def is_nothing_at_zero(case: CheckedEffect) -> None:
    """With all amplitudes zero, a run is that without the effect, bit for bit, whatever the other parameters."""
    names = [item.name for item in case.cls.parameters()]
    values = case.corners(case.generator(), LANES)
    values[[names.index(name) for name in (case.cls.amplitude, *case.cls.further_amplitudes)]] = 0.0
    rows, _ = case.bench.run(case.cls, values)
    if not np.array_equal(rows, case.bench.plain()):
        lane = int(np.argmax((rows != case.bench.plain()).any(axis=(0, 1))))
        raise PluginError(f"it still acts at zero amplitude with {dict(zip(names, values[:, lane], strict=True))}.")


def acts_at_its_typical_size(case: CheckedEffect) -> None:
    """At its typical size the effect changes the record."""
    rows, diverged = case.bench.run(case.cls, case.typical)
    if np.array_equal(rows, case.bench.plain()):
        raise PluginError("a run at the typical size is the same as one without the effect.")
    if diverged.any() or not np.isfinite(rows).all():
        raise PluginError("the axis diverges at the typical size.")


def stays_finite_or_says_so(case: CheckedEffect) -> None:
    """At random corners of the parameter box a run is finite and within the travel, or flagged as diverged."""
    values = case.corners(case.generator(), LANES)
    rows, diverged = case.bench.run(case.cls, values)
    limits = np.array([case.bench.axis().limits[name] for name in case.bench.axis().columns])
    logged = rows[:, : len(limits)]
    held = np.isfinite(logged).all(axis=1)
    within = (np.abs(logged[:, case.bench.positions]) <= 1.01 * limits[case.bench.positions][None, :, None]).all(axis=1)
    silent = ~(held & within).all(axis=0) & ~diverged
    if silent.any():
        lane = int(np.argmax(silent))
        raise PluginError(f"a run that is not flagged leaves the travel or is not finite at {values[:, lane]}.")


def is_resolved_around_its_typical_size(case: CheckedEffect) -> None:
    """Within a factor of two of its typical size, a quarter of the substep changes no more than 2 % of what it does."""
    values = case.around(case.generator(), LANES)
    coarse, _ = case.bench.run(case.cls, values)
    fine, _ = case.bench.run(case.cls, values, refinement=REFINED)
    columns = case.bench.positions
    effect = np.abs(fine - case.bench.plain(REFINED))[:, columns].max(axis=(0, 1))
    change = np.abs(fine - coarse)[:, columns].max(axis=(0, 1))
    excess = change - (RESOLVED * effect + RESOLVED_M)
    lane = int(np.argmax(excess))
    if not excess[lane] <= 0.0:
        raise PluginError(
            f"a quarter of the substep moves the axis by {change[lane]:.2g} m, of {effect[lane]:.2g} m that the "
            f"effect does, at {values[:, lane]}."
        )


def converges_at_second_order(case: CheckedEffect) -> None:
    """At its typical size the error of the table's position falls with the square of the substep."""
    _, column = case.bench.positions
    runs = {n: case.bench.run(case.cls, case.typical, refinement=n)[0][:, column, 0] for n in (1, REFINED, FINEST)}
    error = {n: math.sqrt(np.mean((runs[n] - runs[FINEST]) ** 2)) for n in (1, REFINED)}
    order = math.log(error[1] / error[REFINED], REFINED) if error[REFINED] > 0.0 else math.inf
    if order < LEAST_ORDER:
        raise PluginError(f"the order of convergence is {order:.2f}, {LEAST_ORDER:g} is expected.")


def is_the_same_alone(case: CheckedEffect) -> None:
    """Single runs are bit for bit the lanes of many with the same seed."""
    many, _ = case.bench.run(case.cls, case.typical, n_lanes=MANY_LANES)
    for lane in SOME_LANES:
        alone, _ = case.bench.run(case.cls, case.typical, n_lanes=1, seeds=[lane])
        if not np.array_equal(alone[:, :, 0], many[:, :, lane]):
            raise PluginError(f"lane {lane} of {MANY_LANES} differs from a single run with the same seed.")


def leaves_its_neighbours_alone(case: CheckedEffect) -> None:
    """Lanes in which the effect is off run as if it were nowhere, and the commanded motion is as it was."""
    on = np.arange(LANES) % 2 == 0
    reference = case.bench.axis().reference.copy()
    rows, _ = case.bench.run(case.cls, case.typical, on)
    if not np.array_equal(rows[:, :, ~on], case.bench.plain()[:, :, ~on]):
        raise PluginError("a lane changes although the effect is on in its neighbours only.")
    if not np.array_equal(reference, case.bench.axis().reference):
        raise PluginError("the commanded motion has changed.")


CHECKS: tuple[Callable[[CheckedEffect], None], ...] = (
    declares_what_the_kernel_takes,
    has_bounds_around_its_typical_size,
    carries_units,
    is_documented,
    survives_toml,
    is_compiled_faithfully,
    returns_finite_values,
    is_nothing_at_zero,
    acts_at_its_typical_size,
    stays_finite_or_says_so,
    is_resolved_around_its_typical_size,
    converges_at_second_order,
    is_the_same_alone,
    leaves_its_neighbours_alone,
)


def check_effect(cls: type[Effect]) -> list[str]:
    """Run all checks on an effect and return a line for each; the last one diagnoses it in its own record.

    Raises
    ------
    PluginError
        If a check fails that the plug-in does not list in ``expected_failures``, or passes although it does.
    """
    case = CheckedEffect(cls, EffectBench([cls]))
    checks = [(check.__name__, partial(check, case)) for check in CHECKS]
    return run_checks(
        cls.name, [*checks, (is_named_first.__name__, partial(is_named_first, cls))], cls.expected_failures
    )
