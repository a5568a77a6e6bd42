"""What an axis does before it has left where it stood is simulated, but not compared: nobody knows how it stood."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.runs import RecordedRun, after_lead_ins, prepare, same_command, settling_time_s
from fdbench.effects import effects
from fdbench.plants.feed_drive import Following
from fdbench.record import Record
from fdbench.virtual_axes.library_axis import Tabulated

PERIOD_S = axis_lab.PERIOD_S
LUGRE = effects.get("lugre_friction").typical(coulomb_force_N=150.0, static_force_N=150.0)
AXIS = dataclasses.replace(axis_lab.drive(), effects=(LUGRE,))
NOMINAL = Nominal(plant=AXIS, simulation=Simulation(substeps=10))
SETTLING_S = settling_time_s(AXIS)
BEFORE = ((0.02, 0.0), (-0.03, 0.0))  # stops of the motions before the record, which end on either side


def recorded(before: tuple[float, ...], seed: int) -> Record:
    """Return a record that begins at rest, 0.2 s before the same motion, after another one."""
    first, then = (moves(stops, (0.08,), 2.0, PERIOD_S) for stops in (before, (0.0, 0.06, 0.01, 0.05, 0.0, 0.06)))
    whole = np.vstack((first, np.repeat(then[:1], round(0.5 / PERIOD_S), axis=0), then))
    full = axis_lab.record(AXIS, (), Tabulated(values=whole), len(whole) * PERIOD_S, seed)
    begins = len(whole) - len(then) - round(0.2 / PERIOD_S)
    columns = {name: values[begins:] for name, values in full.items()}
    return Record({**columns, "time_s": columns["time_s"] - columns["time_s"][0]}, {}, full.source)


def test_what_is_compared_is_simulated_from_where_the_record_begins() -> None:
    whole = prepare(recorded(BEFORE[0], seed=1), AXIS)
    (part,) = after_lead_ins([whole], SETTLING_S)
    n = part.n_before
    assert 0 < n == whole.n_samples - part.n_samples <= 0.2 * whole.n_samples
    assert (part.start, part.held_force_N) == (whole.start, whole.held_force_N)
    np.testing.assert_array_equal(part.command, whole.reference)
    np.testing.assert_allclose(part.time_s, PERIOD_S * np.arange(n, whole.n_samples))
    replay, variant = Replay(AXIS, NOMINAL.library, 10), start(NOMINAL).variant
    for loops in (replay, replay.with_loops(2)):
        both = loops.on_each([whole, part, part.up_to(300)], variant)
        for name, values in both[0].items():
            np.testing.assert_array_equal(both[1][name], values[n:])
            np.testing.assert_array_equal(both[2][name], values[n : n + 300])


def test_bristles_that_stand_bent_are_no_gap() -> None:
    """Repeats that begin with bristles bent either way differ, and differ from the exact model, at the start alone."""
    runs = [prepare(recorded(before, seed), AXIS) for seed, before in enumerate(BEFORE)]
    parts = after_lead_ins(runs, SETTLING_S)
    assert same_command(*parts)
    replay, variant = Replay(AXIS, NOMINAL.library, 10), start(NOMINAL).variant
    whole, compared = (
        [np.std(run.channels["position_m"] - replay.alone(run, variant)["position_m"]) for run in group]
        for group in (runs, parts)
    )
    assert min(whole) > 5e-6
    assert max(compared) < 0.05 * min(whole)


def test_a_record_stays_whole_where_much_of_it_would_be_left_out() -> None:
    reference = np.zeros((1000, 3))
    reference[600:, 0] = 0.1
    channels = {"motor_force_N": np.zeros(1000), "position_m": reference[:, 0]}
    late = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)
    still = dataclasses.replace(late, reference=np.zeros((1000, 3)))
    followed = dataclasses.replace(late, reference=np.roll(reference, -550, axis=0), motion=(reference[:, 0], 1e-3))
    for run in (late, still, followed):
        assert after_lead_ins([run], 0.1) == [run]
    early = dataclasses.replace(late, reference=np.roll(reference, -550, axis=0))
    assert early.lead_in_samples(0.1) == 150
    assert early.lead_in_samples(1.0) == 200, "no more than a fifth"


def test_repeats_of_a_measured_motion_lose_as_much_as_the_first_of_them() -> None:
    """Of a baseline, too, which is another day: where they leave their start differs by a few samples."""
    time_s = PERIOD_S * np.arange(2000)
    runs = []
    for place, late_s in enumerate((0.0, 3e-4, 6e-4, 0.0)):
        motion = 0.05 * (1.0 - np.cos((np.pi if place < 3 else 5.0) * (time_s - late_s)))
        channels = {"motor_force_N": np.zeros(2000), "position_m": motion}
        reference = np.column_stack((motion + 1e-3, np.gradient(motion, PERIOD_S), np.zeros(2000)))
        run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=channels, lap=None)
        runs.append(dataclasses.replace(run, motion=(motion, 1e-3)))
    alone = [run.lead_in_samples(0.05) for run in runs]
    assert len(set(alone)) > 1
    baseline = after_lead_ins(runs[:1], 0.05)
    every = after_lead_ins(runs[1:], 0.05, baseline)
    assert [run.n_before for run in every[:2]] == [alone[0]] * 2
    assert same_command(every[0], baseline[0])
    assert every[2].n_before == alone[3]
    assert [run.n_before for run in after_lead_ins(runs[1:3], 0.05)] == [alone[1]] * 2


def test_a_transient_at_the_start_of_a_motion_that_is_followed_is_no_gap() -> None:
    """A joint that is thrown into motion: no virtual loop follows that, and the exact model has no gap after it."""
    whole = recorded(BEFORE[0], seed=3)
    thrown = whole.slice(round(0.3 / PERIOD_S), whole.n_samples)
    columns = {name: thrown[name].copy() for name in ("time_s", "motor_torque_Nm", "motor_position_m", "position_m")}
    columns["motor_torque_Nm"][:3] += 3.0
    nominal, (run,), _ = prepared(
        dataclasses.replace(NOMINAL, plant=dataclasses.replace(AXIS, controller=Following())), [Record(columns)]
    )
    (part,) = after_lead_ins([run], settling_time_s(nominal.drive))
    replay, variant = Replay(nominal.drive, NOMINAL.library, 10), start(nominal).variant
    before, after = (
        np.std(item.channels["motor_force_N"] - replay.alone(item, variant)["motor_force_N"]) for item in (run, part)
    )
    assert 0 < part.n_before < 0.2 * run.n_samples
    assert after < 0.3 * before


def test_a_loop_settles_with_its_slowest_time_constant() -> None:
    assert pytest.approx(4.0 * 0.1) == SETTLING_S
    cascade = AXIS.controller
    stiff = dataclasses.replace(AXIS, controller=dataclasses.replace(cascade, integral_gain_N_per_m=0.0))  # type: ignore[arg-type]
    assert settling_time_s(stiff) == pytest.approx(4.0 / 40.0)
