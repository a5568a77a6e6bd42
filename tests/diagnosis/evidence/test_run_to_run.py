"""What changes from run to run is told from noise, and counts in its own directions only."""

import dataclasses

import numpy as np
import pytest
from axis_lab import drive, other_friction, protocol, record

from fdbench.diagnosis.evidence.prepare import aligned, with_run_to_run_covariance
from fdbench.diagnosis.evidence.run_to_run import Change, Repeatability
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.noise_model import NoiseModel, spectrum_of, white
from fdbench.diagnosis.settings import EVIDENCE, changed
from fdbench.record import Record


def repeats(frictions: list[float]) -> tuple[Nominal, list[Record]]:
    """Return records of one motion on an axis whose friction is another in each."""
    paper = drive()
    motion, duration_s = protocol(1.0)["steps"]
    found = []
    for seed, ratio in enumerate(frictions):
        found.append(record(other_friction(paper, ratio), (), motion, duration_s, seed))
    return Nominal(plant=paper, simulation=Simulation(substeps=10)), found


def steady(frictions: list[float]) -> tuple[Repeatability, dict[str, NoiseModel]]:
    """Return what repeats tell, of all that was recorded: no axis stood otherwise than another when they began."""
    nominal, records = repeats(frictions)
    with changed({"records.longest_lead_in": 0.0}):
        ready = aligned(nominal, records, [])
    return Repeatability(ready.readings.replay, start(ready.nominal), ready.runs), dict(ready.split.noise_models)


def test_friction_that_changes_is_no_noise() -> None:
    """Of 120 N, in standard deviations of 4 %: differences of 2, -3 and 2.5; half their mean square is 3.2."""
    still, _ = steady([1.0, 1.0, 1.0, 1.0])
    rubbing, together = steady([1.0, 1.08, 0.96, 1.06])
    for name, floor in rubbing.noise_models.items():
        assert floor.rms == pytest.approx(still.noise_models[name].rms, rel=0.1)
        assert floor.total == pytest.approx(together[name].rms, rel=1e-3)
    assert together["motor_force_N"].rms > 5.0 * rubbing.noise_models["motor_force_N"].rms
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10))
    changing = [item for item in nominal_parameters(nominal) if item.changes_from_run_to_run]
    place = [item.name for item in changing].index("known_coulomb_friction")
    deviation = changing[place].deviation
    expected = 0.5 * np.mean(np.square([0.08, -0.12, 0.10])) / deviation**2
    assert rubbing.covariance[place, place] == pytest.approx(expected, rel=0.1)
    assert np.trace(still.covariance) < 0.01 * np.trace(rubbing.covariance)


def test_two_runs_that_are_alike_by_chance_do_not_tell_that_friction_stays() -> None:
    """What is assumed counts for one pair: half of the mean square that 2 % of friction changes is to be expected."""
    alike, together = steady([1.0, 1.001])
    changing, _ = steady([1.0, 1.08, 0.96, 1.06])
    alone, _ = steady([1.0])
    for name, floor in alike.noise_models.items():
        assert floor.total == pytest.approx(together[name].rms, rel=0.05)
        assumed = alone.noise_models[name].from_run_to_run
        assert assumed is not None
        assert (floor.expected - 1.0) * floor.total**2 == pytest.approx(0.5 * float(assumed.sum()), rel=0.1)
        assert floor.whole.expected == pytest.approx(floor.expected)
        assert changing.noise_models[name].expected == 1.0
    assert alike.noise_models["position_m"].expected > 4.0


def test_the_mean_of_repeats_is_judged_beside_what_changes() -> None:
    """What another friction leaves of a run counts once, and not in each of its samples."""
    nominal, records = repeats([1.06, 0.95, 1.03])
    ready = aligned(nominal, records[:2], records[2:])
    split = with_run_to_run_covariance(ready.readings.replay, ready, start(ready.nominal))
    for place, run in enumerate(split.runs):
        simulated = ready.readings.alone(place, start(ready.nominal))
        beside = split.gap(place, simulated)
        bare = {
            name: (values - simulated[name]) * np.sqrt(run.repeats) / split.noise_models[name].rms
            for name, values in run.channels.items()
        }
        assert np.mean(bare["position_m"] ** 2) > 20.0
        assert np.mean(beside["position_m"] ** 2) < 0.2 * np.mean(bare["position_m"] ** 2)


def test_without_repeats_friction_alone_is_taken_to_change() -> None:
    nominal, records = repeats([1.05])
    ready = aligned(nominal, records, [])
    found = Repeatability(ready.readings.replay, start(ready.nominal), ready.runs)
    doubt = {"viscous": nominal.uncertainty.viscous, "known_effects": nominal.uncertainty.known_effects}
    changing = [item for item in nominal_parameters(ready.nominal) if item.changes_from_run_to_run]
    expected = [(EVIDENCE.assumed_change / doubt[item.kind]) ** 2 if item.kind in doubt else 0.0 for item in changing]
    np.testing.assert_allclose(found.covariance, np.diag(expected), atol=1e-15)
    change = found.change(ready.runs[0], found.noise_models)
    assert change is not None
    assert 1 <= len(change.directions) <= np.count_nonzero(expected)


def test_without_repeats_what_friction_changes_is_beside_the_assumed_noise() -> None:
    """As much as 2 % of the friction does to each channel, and none of it is noise within a run."""
    alone, _ = steady([1.0])
    nominal, records = repeats([1.0])
    ready = aligned(nominal, records, [])
    (run,), base = ready.runs, start(ready.nominal)
    names = [item.name for item in nominal_parameters(ready.nominal)]
    moved = base.moved_in_turn()[names.index("known_coulomb_friction")]
    simulated = ready.readings.replay.simulate(run, [base.variant, moved.variant])
    share = EVIDENCE.assumed_change / 0.1
    for name, floor in alone.noise_models.items():
        assert not floor.measured
        change = share * (simulated[name][1] - simulated[name][0])
        assert floor.from_run_to_run is not None
        assert float(floor.from_run_to_run.sum()) > 0.9 * float(np.mean(change**2))
        assert floor.total > floor.rms == pytest.approx(np.sqrt(floor.spectrum.sum()))


def test_an_assumed_floor_holds_no_errors_of_nominal_parameters() -> None:
    """A motion that never rests, with a table a tenth heavier: the nominal model leaves of it all the time."""
    motion, duration_s = protocol(1.0)["fast"]
    nominal = Nominal(plant=drive(), simulation=Simulation(substeps=10))
    table = nominal.drive.table
    assert table is not None
    heavy = dataclasses.replace(nominal.drive, table=dataclasses.replace(table, mass_kg=1.1 * table.mass_kg))
    known, found = (aligned(nominal, [record(axis, (), motion, duration_s, 0)], []) for axis in (nominal.drive, heavy))
    given = start(found.nominal)
    moves = [0.1 / item.deviation if item.name == "table_mass" else 0.0 for item in nominal_parameters(found.nominal)]
    after = with_run_to_run_covariance(found.readings.replay, found, given.moved(moves)).noise_models
    for name, floor in known.split.noise_models.items():
        assert found.split.noise_models[name].rms > 1.5 * floor.rms
        assert after[name].rms == pytest.approx(floor.rms, rel=0.1)


def test_whitening_is_the_inverse_root_of_the_covariance() -> None:
    """W (I + S S') W = I, with two channels of 7 samples and two directions."""
    rng = np.random.default_rng(0)
    change_of_values = 3.0 * rng.standard_normal((2, 2, 7))
    flat = change_of_values.reshape(2, 14)
    _, s, directions = np.linalg.svd(flat, full_matrices=False)
    change = Change(directions=directions.reshape(2, 2, 7), shrinkage=1.0 - 1.0 / np.sqrt(1.0 + s**2))
    signals = np.eye(14).reshape(14, 2, 7)
    channels = [np.ascontiguousarray(signals[:, place]) for place in range(2)]
    change.whiten(channels)
    w = np.stack(channels, axis=1).reshape(14, 14)
    np.testing.assert_allclose(w @ (np.eye(14) + flat.T @ flat) @ w.T, np.eye(14), atol=1e-12)


def test_the_floor_of_a_band() -> None:
    """White noise through a moving sum of two is (2 cos(pi f / 2))^2: below half of the range 1/2 + 1/pi of it."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(200_000)
    coloured = noise[1:] + noise[:-1]
    floor = NoiseModel(spectrum=spectrum_of([coloured]), measured=True)
    assert floor.rms == pytest.approx(np.sqrt(2.0), rel=0.01)
    assert floor.shares((0.0, 0.5, 1.0))[0] == pytest.approx(0.5 + 1.0 / np.pi, abs=0.01)
    assert white(3.0, measured=False).rms == pytest.approx(3.0)
