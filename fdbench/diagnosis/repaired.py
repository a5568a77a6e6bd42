"""The repaired model: the nominal parameters re-calibrated and the named effects added, as a model file."""

import dataclasses
import json
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from fdbench.diagnosis.diagnose import Diagnosis
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.rotary_axis import plant_of_rotary
from fdbench.diagnosis.settings import JUDGE
from fdbench.errors import FdbenchError
from fdbench.files import write_text
from fdbench.plants.feed_drive import Following
from fdbench.rotary import ROTARY, rotary_name, spoken_of
from fdbench.specification import snake_case
from fdbench.wording import less, probability_text, si_text

SMALLEST = 1e-12  # noise floor that is divided by


def write_repaired(found: Diagnosis, path: str | Path) -> None:
    """Write the repaired model of a diagnosis as TOML; `fdbench.diagnosis.model.nominal.load_nominal` reads it.

    Where the effects make the prediction of what was held out worse, in the mean over the channels in units of their
    noise, and none of them is named, it is the re-calibrated model.

    Raises
    ------
    FdbenchError
        If the file cannot be written, or the prediction is worse with effects that are named: then nothing is written.
    """
    recalibrated, with_effects = prediction_errors(found)
    is_worse = bool(found.final.effects) and with_effects > recalibrated
    is_named = any(cause.probability > JUDGE.named for cause in found.answer.causes)
    if is_worse and is_named:
        raise FdbenchError(
            f"{path}: not written: on {found.answer.shrinkage.judged_on_words} the repaired model predicts worse than "
            f"the re-calibrated one ({with_effects:.3g} against {recalibrated:.3g} times the noise, in the mean over "
            "the channels). The answer stands without it; a model that predicts better needs more records, or other "
            "motions."
        )
    write_text(path, model_text(dataclasses.replace(found, final=found.calibrated) if is_worse else found))


def prediction_errors(found: Diagnosis) -> tuple[float, float]:
    """Return the held-out errors of the re-calibrated and the repaired model, mean over channels in units of noise."""
    gaps = found.answer.gap.channels.values()
    means = [
        sum(error / max(gap.noise_floor, SMALLEST) for gap, error in zip(gaps, errors, strict=True)) / len(gaps)
        for errors in ([gap.recalibrated for gap in gaps], [gap.repaired for gap in gaps])
    ]
    return means[0], means[1]


def model_text(found: Diagnosis) -> str:
    """Return the repaired model as TOML, with what was changed as comments."""
    with spoken_of(found.answer.axis):
        history = list(_history(found))
    lines = [*(f"# {line}" for line in history), *toml_lines(_table_of(repaired(found)))]
    return "\n".join(lines) + "\n"


def repaired(found: Diagnosis) -> Nominal:
    """Return the final model of a diagnosis, with its controller as given where it was made to follow the motion."""
    final, asked = as_nominal(found.final), found.asked.drive.controller
    if not _was_left_out(found):
        return final
    return dataclasses.replace(final, plant=dataclasses.replace(final.drive, controller=asked))


def _was_left_out(found: Diagnosis) -> bool:
    asked, used = found.asked.drive.controller, found.final.nominal.drive.controller
    return isinstance(used, Following) and not isinstance(asked, Following)


def _table_of(nominal: Nominal) -> dict[str, Any]:
    table = table_of(nominal, Nominal)
    if nominal.axis != ROTARY:
        return {key: value for key, value in table.items() if key != "axis"}
    doubt = {rotary_name(key): value for key, value in table["uncertainty"].items()}
    return {**table, "plant": plant_of_rotary(table["plant"]), "uncertainty": doubt}


def _history(found: Diagnosis) -> Iterator[str]:
    shrinkage, causes = found.answer.shrinkage, {cause.effect: cause for cause in found.answer.causes}
    if found.final.effects:
        yield "Repaired by fdbench diagnose: the nominal model, re-calibrated, with the effects that were named."
    else:
        yield "Written by fdbench diagnose: the nominal model, re-calibrated; no effect was added."
    if _was_left_out(found):
        yield "It was made to follow the measured motion. The controller is as it was given, and was not judged."
    yield f"Prediction error, root mean square on {shrinkage.judged_on_words}:"
    for name, gap in found.answer.gap.channels.items():
        errors = [("nominal", gap.before), ("re-calibrated", gap.recalibrated)]
        errors += [("repaired", gap.repaired)] if found.final.effects else []
        parts = ", ".join(f"{words} {si_text(error, gap.unit)}" for words, error in errors)
        yield f"  {name}: {parts}; noise floor {si_text(gap.noise_floor, gap.unit)}."
    if found.final.effects:
        yield (
            f"Judged on {shrinkage.judged_on_words}: after re-calibration the effects make the mean squared gap "
            f"{less(shrinkage.total, shrinkage.ci95)}."
        )
    for effect in found.final.effects:
        yield f"Added: {effect.name}, probability {probability_text(causes[effect.name].probability)}."
    for item, shift in zip(nominal_parameters(found.final.nominal), found.final.shifts, strict=True):
        yield f"Re-calibrated: {item.name} by {shift:+.2f} of its standard deviations."


# ---- the inverse of fdbench.specification.read ----


def table_of(specification: Any, hint: Any) -> dict[str, Any]:
    """Return the TOML table that is read as a specification.

    Parameters
    ----------
    specification : dataclass
    hint : type
        What the field is annotated with; where that leaves a choice, the table has a ``kind``.

    Examples
    --------
    >>> from fdbench.plants.feed_drive import LinearMotor, RotaryMotor
    >>> table_of(LinearMotor(mass_kg=2.0, viscous_friction_N_s_per_m=1.0), LinearMotor | RotaryMotor)
    {'kind': 'linear_motor', 'mass_kg': 2.0, 'viscous_friction_N_s_per_m': 1.0}
    """
    cls = type(specification)
    options = [option for option in typing.get_args(hint) if option is not type(None)] if _is_union(hint) else [hint]
    kind = {} if options == [cls] else {"kind": getattr(cls, "name", snake_case(cls.__name__))}
    hints = typing.get_type_hints(cls)
    values = {field.name: getattr(specification, field.name) for field in dataclasses.fields(cls) if field.init}
    return kind | {name: _value(value, hints[name]) for name, value in values.items() if value is not None}


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _value(value: Any, hint: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return table_of(value, hint)
    if isinstance(value, tuple):
        inner = typing.get_args(hint)
        return [_value(item, inner[0] if inner[-1] is Ellipsis else inner[i]) for i, item in enumerate(value)]
    return value


def toml_lines(table: Mapping[str, Any], path: str = "") -> Iterator[str]:
    r"""Yield the lines of a TOML table: its values first, then the tables and lists of tables in it.

    >>> print("\n".join(toml_lines({"a": {"b": 1e-3, "c": "x"}, "d": True, "e": [{"f": [1, 2]}]})))
    d = true
    <BLANKLINE>
    [a]
    b = 0.001
    c = "x"
    <BLANKLINE>
    [[e]]
    f = [1, 2]
    """
    told = {key: value for key, value in table.items() if value not in ([], {})}
    inner = {key: value for key, value in told.items() if isinstance(value, Mapping) or _lists_tables(value)}
    for key, value in told.items():
        if key not in inner:
            yield f"{key} = {_literal(value)}"
    for key, value in inner.items():
        name = f"{path}{key}"
        for item in [value] if isinstance(value, Mapping) else value:
            yield from ("", f"[{name}]" if isinstance(value, Mapping) else f"[[{name}]]")
            yield from toml_lines(item, f"{name}.")


def _lists_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _literal(value: bool | int | float | str | Sequence[Any]) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(float(value) if isinstance(value, float) else value)
    return f"[{', '.join(_literal(item) for item in value)}]"
