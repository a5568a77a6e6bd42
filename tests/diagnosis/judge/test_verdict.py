"""Probabilities of look-alikes: one claim, divided as the misfits have it."""

import pytest
from axis_lab import drive

from fdbench.diagnosis import answer
from fdbench.diagnosis.answer import ForceBalances
from fdbench.diagnosis.judge.look_alikes import divided, force_balances
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.search.stage import Rival, Stage
from fdbench.effects import effects

LAG, DELAY, CABLE = (type(effects.get(name).typical()) for name in ("current_loop_lag", "dead_time", "cable_stiffness"))


def stage(misfit: float, **rivals: float) -> Stage:
    """Return a stage with the misfit of the base and those of rivals by name."""
    base = start(Nominal(plant=drive(), simulation=Simulation(substeps=10)))
    found = [
        Rival(
            kind=type(item),
            hypothesis=base.with_effect(item),
            misfit=own,
            penalty=0.0,
            refined=True,
            size=1.0,
            own_size=1.0,
        )
        for item, own in ((effects.get(name).typical(), own) for name, own in rivals.items())
    ]
    return Stage(base=base, misfit=misfit, penalty=0.0, test_count=1000.0, rivals=tuple(found))


def test_look_alikes_divide_one_probability() -> None:
    found = divided(stage(3.0, dead_time=1.10, current_loop_lag=1.12, cable_stiffness=2.9), DELAY, [LAG.name], 0.9)
    assert found["dead_time"] + found["current_loop_lag"] == pytest.approx(0.9)
    assert found["dead_time"] / found["current_loop_lag"] == pytest.approx((1.12 / 1.10) ** 30)
    assert found.get("cable_stiffness", 0.0) < 0.02


def test_beyond_all_doubt_look_alikes_are_divided_too() -> None:
    """Evidence against all others is so strong that what these leave to them is zero in double precision."""
    found = divided(stage(1e9, dead_time=1.0, current_loop_lag=1.0), DELAY, [LAG.name], 0.99)
    assert found == pytest.approx({"dead_time": 0.495, "current_loop_lag": 0.495})


def test_the_force_balance_check_leaves_look_alikes_aside() -> None:
    removed = {DELAY: 0.5, LAG: 0.6, CABLE: 0.2}
    best_other = answer.RivalReduction(effect="cable_stiffness", reduction=0.2)
    assert force_balances(removed, DELAY, [LAG.name]) == ForceBalances(reduction=0.5, instead=best_other)
    assert force_balances({DELAY: 0.5}, DELAY, []) == ForceBalances(reduction=0.5)
