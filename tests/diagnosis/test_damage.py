"""Damage of a record is told as damage, by kind and place, and never explained by physics."""

import functools
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from types import SimpleNamespace

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records import damage
from fdbench.diagnosis.records.damage import check_damage
from fdbench.diagnosis.records.plausibility import noise_estimate
from fdbench.diagnosis.records.runs import FORCE, prepare
from fdbench.effects import effects
from fdbench.errors import RecordError
from fdbench.record import Record

Columns = dict[str, np.ndarray]
PLACE = 1500


@functools.lru_cache(maxsize=1)
def healthy() -> tuple[Nominal, Record]:
    nominal, fitted, _ = axis_lab.case((), 1)
    return nominal, fitted[-1]


def renewed(columns: Columns) -> Columns:
    """Return columns on a clock without gaps."""
    return columns | {"time_s": np.arange(len(columns["time_s"])) * axis_lab.PERIOD_S}


def rows(columns: Columns, chosen: np.ndarray) -> Columns:
    return {name: values[chosen] for name, values in columns.items()}


def changed(columns: Columns, where: slice, **values: float) -> Columns:
    result = {name: np.array(own) for name, own in columns.items()}
    for name, value in values.items():
        result[name][where] = value
    return result


def dropped(columns: Columns) -> Columns:
    return rows(columns, np.delete(np.arange(len(columns["time_s"])), np.arange(PLACE, PLACE + 60)))


def doubled(columns: Columns) -> Columns:
    index = np.arange(len(columns["time_s"]))
    return rows(columns, np.concatenate((index[:PLACE], index[PLACE - 100 :])))


def zeroed(columns: Columns) -> Columns:
    measured = [name for name in columns if name != "time_s" and "reference" not in name]
    return changed(columns, slice(-900, None), **dict.fromkeys(measured, 0.0))


def frozen(columns: Columns) -> Columns:
    measured = [name for name in columns if name != "time_s" and "reference" not in name]
    held = {name: float(columns[name][PLACE]) for name in measured}
    return changed(columns, slice(PLACE, PLACE + 200), **held)


def spike(columns: Columns, size_m: float = 0.02) -> Columns:
    shifted = {name: float(columns[name][PLACE]) + size_m for name in ("position_m", "motor_position_m")}
    return changed(columns, slice(PLACE, PLACE + 1), **shifted)


def many_spikes(columns: Columns) -> Columns:
    for place in range(50, 2950, 50):
        shifted = {name: float(columns[name][place]) + 0.02 for name in ("position_m", "motor_position_m")}
        columns = changed(columns, slice(place, place + 1), **shifted)
    return columns


def force_spike(columns: Columns) -> Columns:
    peak = 10.0 * float(np.quantile(np.abs(columns["motor_torque_Nm"]), 0.99))
    return changed(columns, slice(PLACE, PLACE + 1), motor_torque_Nm=peak)


DAMAGES: Mapping[str, tuple[Callable[[Columns], Columns], str]] = {
    "rows dropped, gap in time": (dropped, r"time_s jumps at sample 1500.* 60 samples"),
    "rows dropped, clock renewed": (lambda c: renewed(dropped(c)), r"jumps by .* after sample 1499.* Missing rows"),
    "zeros at the end": (zeroed, "position are zero for 900 samples at its end, from sample 2100"),
    "frozen within": (frozen, "position are constant for 200 samples within it, from sample 1500"),
    "position spike of 20 mm": (spike, r"position_m jumps by 0.0[12].* after sample 1499.* damaged sample: cut it out"),
    "58 position spikes": (many_spikes, r"position_m has 58 spikes of one sample, the largest of 0.02.* m at sample"),
    "force spike": (force_spike, "motor_force_N is .* N at sample 1500 .* did not feel it"),
    "block written twice, clock renewed": (lambda c: renewed(doubled(c)), "repeat those 100 samples before"),
    "block written twice, clock kept": (doubled, "time_s does not increase at sample 1500"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_told_by_kind_and_place(damage: str) -> None:
    nominal, record = healthy()
    spoil, words = DAMAGES[damage]
    with pytest.raises(RecordError, match=words):
        aligned(nominal, [Record(spoil(dict(record.columns)))], [])


@pytest.mark.parametrize("damage", ["rows dropped, clock renewed", "position spike of 20 mm", "force spike"])
def test_damage_is_told_without_a_command_too(damage: str) -> None:
    nominal, record = healthy()
    spoil, words = DAMAGES[damage]
    columns = {name: values for name, values in record.columns.items() if "reference" not in name}
    with pytest.raises(RecordError, match=words):
        aligned(nominal, [Record(spoil(columns))], [])


@pytest.mark.parametrize("name", ["dropped_samples", "encoder_quantisation", "backlash"])
def test_no_effect_passes_for_damage(name: str) -> None:
    kind = effects.get(name)
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    record = axis_lab.record(axis_lab.drive(), (kind.typical(),), motion, duration_s, seed=7)
    run = prepare(record, healthy()[0].drive)
    check_damage(run, healthy()[0].drive, noise_estimate(run.channels["position_m"]))


@pytest.mark.parametrize(("n_alike", "is_damage"), [(80, False), (500, True)])
def test_coarse_readings_may_repeat_themselves_for_a_while_as_the_command_does(n_alike: int, is_damage: bool) -> None:
    rng, n, lap = np.random.default_rng(0), 3000, 500
    command = 0.01 * np.sin(2.0 * np.pi * np.arange(n) / lap)
    position, force = command + 1e-6 * rng.standard_normal(n), 50.0 + rng.standard_normal(n)
    copied = slice(1300, 1300 + n_alike)
    for values in (position, force):
        values[copied] = values[1300 - lap : 1300 - lap + n_alike]
    columns = {"reference_position_m": command, "position_m": position, "motor_force_N": force}
    nominal = healthy()[0]
    run = prepare(Record(renewed({"time_s": np.arange(n), **columns})), nominal.drive)
    with pytest.raises(RecordError, match="written twice") if is_damage else nullcontext():
        damage._refuse_copies(run, position, force)


def test_what_no_logger_wrote_may_repeat_itself() -> None:
    """As a simulation without noise does, of which a calibration asks its floors."""
    nominal, record = healthy()
    repeating = Record(renewed(doubled(dict(record))), source="simulated")
    with pytest.raises(RecordError, match="A block was written twice"):
        aligned(nominal, [repeating], [])
    assert aligned(nominal, [repeating], [], logged=False).runs


def force_as(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Columns], Columns]:
    return lambda columns: columns | {"motor_torque_Nm": change(np.array(columns["motor_torque_Nm"]))}


NOT_A_FORCE: Mapping[str, tuple[Callable[[Columns], Columns], str]] = {
    "shuffled": (force_as(np.random.default_rng(1).permutation), "not the force that moved the axis"),
    "white noise": (
        force_as(lambda x: x.std() * np.random.default_rng(1).standard_normal(len(x))),
        "not the force that moved the axis",
    ),
    "wrapped": (force_as(lambda x: (x + 0.5 * x.max()) % x.max() - 0.5 * x.max()), "not the force that moved the axis"),
    "dead in its second half": (
        force_as(lambda x: np.where(np.arange(len(x)) < PLACE, x, 0.0)),
        r"motor_force_N is 0 N for 1500 samples from sample 1500 .* wrote no readings there",
    ),
    "frozen": (
        force_as(lambda x: np.where(abs(np.arange(len(x)) - PLACE) < 400, x[PLACE], x)),
        r"motor_force_N is .* N for 799 samples from sample 1101 .* wrote no readings there",
    ),
}


@pytest.mark.parametrize("damage", NOT_A_FORCE)
def test_a_column_that_is_no_force_of_this_axis_is_told_as_one(damage: str) -> None:
    nominal, record = healthy()
    spoil, words = NOT_A_FORCE[damage]
    with pytest.raises(RecordError, match=words):
        aligned(nominal, [Record(spoil(dict(record.columns)))], [])


@pytest.mark.parametrize("name", ["periodic_force", "force_saturation", "backlash", "lugre_friction"])
def test_no_effect_passes_for_a_foreign_column(name: str) -> None:
    """At ten times its typical size, where it can be that large."""
    nominal, _ = healthy()
    kind = effects.get(name)
    effect = kind.typical() if name == "force_saturation" else kind.typical().scaled(10.0)
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    record = axis_lab.record(axis_lab.drive(), (effect,), motion, duration_s, seed=7)
    assert aligned(nominal, [record], []).runs


@pytest.mark.parametrize(("share", "doubt", "refused"), [(-1.0, 0.4, False), (0.0, 0.05, True)])
def test_few_parts_of_a_record_have_to_speak_plainly_for_a_force_of_another_axis(
    monkeypatch: pytest.MonkeyPatch, share: float, doubt: float, refused: bool
) -> None:
    """Three standard errors that eight parts tell are no more sure than two that many would."""
    monkeypatch.setattr(damage, "_share_of", lambda asked, force: (share, doubt, 8))
    run = SimpleNamespace(name="a.csv", channels={FORCE: np.linspace(-1.0, 1.0, 100)})
    with pytest.raises(RecordError, match="not the force that moved the axis") if refused else nullcontext():
        damage.check_force_is_own(run, np.zeros(100))  # type: ignore[arg-type]
