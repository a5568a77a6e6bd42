"""The verdict on an axis that turns is the same whatever its size: motors of a few grams, and turns in any unit."""

import dataclasses
from typing import Any

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.effects import Effect, Scale, at_scale, effects
from fdbench.record import Record
from fdbench.rotary import rotary_name
from fdbench.units import unit_of

ON_THE_ARC = {"kg m^2": "kg", "N m": "N", "N m s/rad": "N s/m"}
SMALL, SMALLER = Scale(length=12.0, force=2e-3), Scale(length=90.0, force=5e-5)


def resized(specification: Any, scale: Scale) -> Any:
    """Return a plant, a part of it or an effect with every number in the units of another size."""
    if isinstance(specification, tuple):
        return tuple(resized(item, scale) for item in specification)
    if not dataclasses.is_dataclass(specification):
        return specification
    changes = {
        field.name: scale.of(unit_of(field.name)) * value if isinstance(value, float) else resized(value, scale)
        for field in dataclasses.fields(specification)
        for value in [getattr(specification, field.name)]
    }
    if isinstance(specification, Effect):
        return at_scale(type(specification), scale)(**changes)
    return dataclasses.replace(specification, **changes)


def record_of(original: Record, scale: Scale) -> Record:
    """Return a record of a turning axis of another size."""
    columns = {rotary_name(name): scale.of(unit_of(name)) * original[name] for name in original}
    return Record(columns, original.provenance, original.source)


def test_the_verdict_does_not_depend_on_the_size() -> None:
    name = "stribeck_friction"
    nominal, fitted, judged = axis_lab.case((effects.get(name).typical(),), seed=3)
    answers = []
    for scale in (SMALL, SMALLER):
        own = dataclasses.replace(nominal, plant=resized(nominal.plant, scale), axis="rotary")
        groups = [[record_of(item, scale) for item in group] for group in (fitted, judged)]
        answers.append(diagnose(own, *groups).answer)
    first, second = answers
    assert first.causes[0].effect == name
    assert first.causes[0].probability > 0.5
    assert [cause.effect for cause in first.causes] == [cause.effect for cause in second.causes]
    for one, other in zip(first.causes, second.causes, strict=True):
        assert one.probability == pytest.approx(other.probability, abs=1e-3)
        for parameter, value in one.parameters.items():
            unit = unit_of(parameter) or ON_THE_ARC[value.unit]  # the change of a nominal value has none in its name
            ratio = SMALLER.of(unit) / SMALL.of(unit)
            if unit != "rad":
                low, high = other.parameters[parameter].ci95 or (0.0, 0.0)
                # A number that hardly anything tells moves with the rounding of what it is fitted to.
                told = pytest.approx(other.parameters[parameter].value, rel=1e-3, abs=1e-3 * (high - low))
                assert ratio * value.value == told
    assert first.unknown_probability == pytest.approx(second.unknown_probability, abs=1e-3)


def test_an_axis_of_usual_size_has_the_effects_as_they_are_declared() -> None:
    nominal, *_ = axis_lab.case((), seed=3)
    typical = {kind.name: kind.typical().values() for kind in nominal.library}
    assert typical == {name: effects.get(name).typical().values() for name in typical}


def test_what_is_known_of_a_large_axis_need_only_have_the_right_sign() -> None:
    kind = at_scale(effects.get("coulomb_friction"), Scale())
    assert kind(coulomb_force_N=2e4, transition_velocity_m_per_s=0.5).coulomb_force_N == 2e4
    with pytest.raises(Exception, match=r"transition_velocity_m_per_s: -1 is outside \[0, inf\] m/s"):
        kind(coulomb_force_N=2e4, transition_velocity_m_per_s=-1.0)
    assert np.isfinite(kind.typical().coulomb_force_N)
