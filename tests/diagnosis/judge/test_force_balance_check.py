"""Force balances tell what acts on the axis from what the nominal controller makes of it."""

import dataclasses

import numpy as np
import pytest
from axis_lab import case, drive

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.judge.force_balance_check import force_balances_removed, silenced, smoothed
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.effects import effects
from fdbench.plants._controllers import Cascade


@pytest.mark.parametrize("gain", [1.0, 1.3])
def test_forces_speak_for_what_acts_whatever_the_controller(gain: float) -> None:
    """Cogging as recorded, beside Coulomb friction that is off, with the nominal velocity gain wrong by 30 %."""
    true = effects.get("cogging").typical()
    nominal, fitted, judged = case((true,), seed=3)
    controller = drive().controller
    assert isinstance(controller, Cascade)
    wrong = dataclasses.replace(controller, velocity_gain_N_s_per_m=gain * controller.velocity_gain_N_s_per_m)
    nominal = dataclasses.replace(nominal, plant=dataclasses.replace(nominal.plant, controller=wrong))
    ready = aligned(nominal, fitted, judged)
    search = Search(Refinement(ready.readings, ready.split))
    base = search.refinement.refine(start(ready.nominal))
    other = effects.get("stribeck_friction").typical()
    stage = search.compared(base, [(type(item), base.with_effect(item), False) for item in (true, other)])
    told = force_balances_removed(ready.readings, ready.split, stage)
    assert told[type(true)] > 0.5
    assert told[type(other)] < 0.2
    assert told.keys() == {type(true), type(other)}


def test_the_filter_passes_slow_forces_only() -> None:
    time = np.arange(4000) * 1e-3
    forces = np.stack([np.sin(2.0 * np.pi * 6.0 * time), np.sin(2.0 * np.pi * 60.0 * time)])
    slow, edge = smoothed(forces, 1e-3)
    assert slow == pytest.approx(forces[0], abs=0.01)
    assert float(np.max(np.abs(edge))) == pytest.approx(np.sqrt(0.5), rel=0.01)


def test_a_rival_that_diverges_changes_nothing() -> None:
    gaps = {"motor_force_N": np.array([[1.0, 2.0], [np.inf, 0.0], [0.0, 0.0]])}
    assert silenced(gaps).tolist() == [False, True, False]
    assert gaps["motor_force_N"].tolist() == [[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]]
