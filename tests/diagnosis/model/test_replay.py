"""Lanes of different runs side by side read what each reads alone, and what is kept is not simulated again."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.commands import at_each_loop
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay, Replayed
from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.diagnosis.settings import changed
from fdbench.effects import effects
from fdbench.simulate.system import Noise, Setup, Timing
from fdbench.virtual_axes.library_axis import Tabulated

PERIOD_S = 1e-3
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=4), uncertainty=Uncertainty())
CHANNELS = ("motor_force_N", "position_m", DEFLECTION)


def run_of(stops: tuple[float, ...]) -> RecordedRun:
    reference = moves(stops, (0.08,), 2.0, PERIOD_S)
    still = dict.fromkeys(CHANNELS, np.full(len(reference), stops[0]))
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=still, lap=None)


def test_runs_side_by_side_read_what_they_read_alone() -> None:
    """Three runs of different length, with an effect over time: bit for bit, whether simulated together or not."""
    replay = Replay(NOMINAL.drive, NOMINAL.library, 4)
    runs = [run_of(stops) for stops in ((0.0, 0.06, 0.01), (0.02, 0.05), (0.01, 0.04, 0.0, 0.05))]
    assert len({run.n_samples for run in runs}) == 3
    base = start(NOMINAL)
    drifting = base.with_effect(effects.get("friction_drift").typical())
    hypotheses = [base, drifting, base.with_effect(effects.get("periodic_force").typical()), base]
    together = list(Readings(replay, runs).each(dict.fromkeys(range(3), hypotheses)))
    with changed({"model.held_at_once": 1}):
        one_by_one = list(Readings(replay, runs).each(dict.fromkeys(range(3), hypotheses)))
    for run, found, expected in zip(runs, together, one_by_one, strict=True):
        alone = replay.simulate(run, [drifting.variant])
        for name in CHANNELS:
            assert found[name].shape == (4, run.n_samples)
            np.testing.assert_array_equal(found[name], expected[name])
            np.testing.assert_array_equal(found[name][1], alone[name][0])
            np.testing.assert_array_equal(found[name][3], found[name][0])
            assert not np.array_equal(found[name][0], found[name][1])


def test_what_memory_held_before_is_never_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is shorter than a piece fills a part of it."""
    empty = np.empty

    def worst(*given: Any, **further: Any) -> np.ndarray:
        found = empty(*given, **further)
        if found.dtype == np.float64:
            found.fill(np.inf)
        return found

    monkeypatch.setattr(np, "empty", worst)
    runs = [run_of((0.0, 0.06, 0.01)), run_of((0.02, 0.05))]
    replay = Replay(NOMINAL.drive, NOMINAL.library, 4)
    for found in Readings(replay, runs).each(dict.fromkeys(range(2), [start(NOMINAL)] * 2)):
        assert all(np.isfinite(found[name]).all() for name in CHANNELS)


@pytest.mark.parametrize("loops", [2, 3])
def test_a_controller_that_acts_more_often_is_that_of_the_shorter_period(loops: int) -> None:
    """Beside the simulator of the environments at the controller's own period; pieces of 1024 are crossed."""
    run = run_of((0.0, 0.06, 0.01, 0.05))
    fine = at_each_loop(run.reference, PERIOD_S, loops)
    assert len(fine) == loops * run.n_samples > 2048
    np.testing.assert_array_equal(fine[::loops], run.reference)
    timing = Timing(sampling_time_s=PERIOD_S / loops, duration_s=len(fine) * PERIOD_S / loops, substeps=2)
    system = NOMINAL.drive.system(Setup(timing=timing, motion=Tabulated(values=fine), noise=Noise()))
    system.start([0])
    rows = system.advance(len(fine))[::loops, :, 0]
    expected = dict(zip(system.columns, rows.T, strict=False))
    variant = start(NOMINAL).variant
    found = Replay(NOMINAL.drive, NOMINAL.library, 2 * loops, loops).alone(run, variant)
    np.testing.assert_allclose(found["position_m"], expected["position_m"], rtol=0.0, atol=1e-12)
    slower = Replay(NOMINAL.drive, NOMINAL.library, 2 * loops).alone(run, variant)
    assert np.abs(slower["position_m"] - expected["position_m"]).max() > 1e-7


def test_what_is_kept_is_not_simulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    replay = Replay(NOMINAL.drive, NOMINAL.library, 4)
    readings = Readings(replay, [run_of((0.0, 0.06))])
    base = start(NOMINAL)
    moved = base.moved_in_turn()[0]
    first = readings.of(0, [base, moved], keep=[moved])
    fill = Replay.fill

    def nothing_new(self: Replay, replayed: Sequence[Replayed]) -> None:
        assert not any(item.variants for item in replayed)
        fill(self, replayed)

    monkeypatch.setattr(Replay, "fill", nothing_new)
    second = readings.of(0, [moved, moved])
    for name in CHANNELS:
        np.testing.assert_array_equal(second[name], first[name][[1, 1]])
        second[name][:] = 0.0  # the caller's own
        np.testing.assert_array_equal(readings.of(0, [moved])[name][0], first[name][1])
    readings.forget([moved])
    with pytest.raises(AssertionError):
        readings.of(0, [moved])
