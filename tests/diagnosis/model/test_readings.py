"""Readings at few substeps are those at many, but for what hypotheses move the error of the integration by."""

import gc
import weakref

import numpy as np
from axis_lab import drive

from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import DEFLECTION, FORCE, RecordedRun
from fdbench.effects import effects

PERIOD_S = 1e-3
FINE = 20
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=FINE))
CHANNELS = (FORCE, "position_m", DEFLECTION)


def run() -> RecordedRun:
    reference = moves((0.0, 0.06, 0.01), (0.08,), 2.0, PERIOD_S)
    still = dict.fromkeys(CHANNELS, np.zeros(len(reference)))
    return RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=still, lap=None)


def test_few_substeps_read_what_many_do() -> None:
    """Of the nominal model to the last digit; with other masses or one more effect most of the error is gone."""
    own = run()
    fine = Readings(Replay(NOMINAL.drive, NOMINAL.library, FINE), [own])
    given = start(NOMINAL)
    rough = Readings(fine.replay.with_substeps(2), [own])
    errors = {name: fine.alone(0, given)[name] - rough.alone(0, given)[name] for name in CHANNELS}
    noise = {name: white(10.0 * float(np.sqrt(np.mean(error**2))), measured=True) for name, error in errors.items()}
    coarse = fine.coarsened(given, noise)
    assert coarse.replay.substeps == 2
    others = [given.moved_in_turn()[0], given.with_effect(effects.get("cogging").typical())]
    for place, hypothesis in enumerate([given, *others]):
        for name in CHANNELS:
            true = fine.alone(0, hypothesis)[name]
            left, was = (np.sqrt(np.mean((read.alone(0, hypothesis)[name] - true) ** 2)) for read in (coarse, rough))
            assert left <= (0.5 * was if place else 1e-12)
    shorter = own.up_to(400)
    begun = coarse.up_to([shorter])
    for name in CHANNELS:
        np.testing.assert_array_equal(begun.alone(0, others[0])[name], coarse.alone(0, others[0])[name][:400])


def test_what_no_coarser_substeps_read_is_read_by_all() -> None:
    own = run()
    fine = Readings(Replay(NOMINAL.drive, NOMINAL.library, FINE), [own])
    silent = {name: white(1e-12, measured=True) for name in CHANNELS}
    assert fine.coarsened(start(NOMINAL), silent) is fine


def test_what_comes_at_once_is_read_with_more_substeps() -> None:
    """A tooth that enters moves a force at once; beside it more substeps are needed than for the nominal model."""
    own = run()
    fine = Readings(Replay(NOMINAL.drive, NOMINAL.library, FINE), [own])
    given = start(NOMINAL)
    milling = given.with_effect(effects.get("tooth_passing_force").typical(axial_depth_m=2e-3))
    rough = Readings(fine.replay.with_substeps(2), [own])
    lost = {
        name: np.sqrt(np.mean((fine.alone(0, milling)[name] - rough.alone(0, milling)[name]) ** 2)) for name in CHANNELS
    }
    noise = {name: white(2.0 * float(own), measured=True) for name, own in lost.items()}
    coarse = fine.coarsened(given, noise)
    assert coarse.about(given, noise) is coarse
    closer = coarse.about(milling, noise)
    assert coarse.replay.substeps < closer.replay.substeps < FINE
    for name in CHANNELS:
        np.testing.assert_allclose(closer.alone(0, milling)[name], fine.alone(0, milling)[name], rtol=0.0, atol=1e-12)
    assert fine.about(milling, noise) is fine


def test_one_substep_tells_the_response_of_what_is_near() -> None:
    """The hypothesis itself is read to the last digit; of the response to another effect little is lost."""
    fine = Readings(Replay(NOMINAL.drive, NOMINAL.library, FINE), [run()])
    given = start(NOMINAL)
    beside = given.with_effect(effects.get("cogging").typical())
    rough = fine.roughly(given)
    assert rough.replay.substeps == 1
    assert rough.responses is fine.responses
    assert fine.roughly(given) is rough
    assert fine.roughly(beside) is not rough
    one = Readings(fine.replay.with_substeps(1), fine.runs)
    assert one.roughly(given) is one
    for name in CHANNELS:
        given_read, beside_read = (fine.alone(0, item)[name] for item in (given, beside))
        np.testing.assert_array_equal(rough.alone(0, given)[name], given_read)
        lost = np.sqrt(np.mean((rough.alone(0, beside)[name] - beside_read) ** 2))
        assert 0.0 < lost < 0.2 * np.sqrt(np.mean((beside_read - given_read) ** 2))


def test_readings_are_gone_with_who_asked_for_them() -> None:
    """At once, not when garbage is collected: of long records they are hundreds of megabytes."""
    fine = Readings(Replay(NOMINAL.drive, NOMINAL.library, FINE), [run()])
    coarse = fine.coarsened(start(NOMINAL), {name: white(1e3, measured=True) for name in CHANNELS})
    assert coarse.finer is fine
    assert fine.coarsened(start(NOMINAL), {name: white(1e3, measured=True) for name in CHANNELS}) is coarse
    held = [weakref.ref(item) for item in (fine, coarse, coarse.roughly(start(NOMINAL)))]
    gc.disable()
    try:
        del fine, coarse
        assert [item() for item in held] == [None] * len(held)
    finally:
        gc.enable()
