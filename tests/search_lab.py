"""Two noisy runs of an axis with known effects, and a search in them."""

import dataclasses

import numpy as np
from axis_lab import drive

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.stage import Rival
from fdbench.effects import Effect

PERIOD_S = 1e-3
FLOORS = {"motor_force_N": 4.0, "position_m": 5e-7, "motor_minus_table_position_m": 5e-8}
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))


def search(*extra: Effect, speeds_m_per_s: tuple[float, ...] = (0.08,), nominal: Nominal = NOMINAL) -> Search:
    """Return a search in two noisy runs of an axis with effects; the second one is held out."""
    replay = Replay(nominal.drive, nominal.library, nominal.simulation.substeps)
    rng, runs = np.random.default_rng(0), []
    base = start(nominal)
    for item in extra:
        base = base.with_effect(item)
    for stops in ((0.0, 0.06, 0.01), (0.0, 0.05, 0.02)):
        reference = moves(stops, speeds_m_per_s, 2.0, PERIOD_S)
        still = dict.fromkeys(FLOORS, np.zeros(len(reference)))
        run = RecordedRun(name="x", period_s=PERIOD_S, reference=reference, channels=still, lap=None)
        simulated = replay.simulate(run, [base.variant])
        noisy = {name: own[0] + FLOORS[name] * rng.standard_normal(len(own[0])) for name, own in simulated.items()}
        runs.append(dataclasses.replace(run, channels=noisy))
    held_out = [np.full(run.n_samples, place == 1) for place, run in enumerate(runs)]
    noise_models = {name: white(rms, measured=True) for name, rms in FLOORS.items()}
    split = Split(runs=runs, held_out=held_out, noise_models=noise_models)
    return Search(Refinement(Readings(replay, runs), split))


def refined_rival(base: Hypothesis, item: Effect, misfit: float, size: float = 1.0) -> Rival:
    """Return a rival that adds an effect of this size to a base, fitted in closed loop, with this misfit."""
    return Rival(
        kind=type(item),
        hypothesis=base.with_effect(item),
        misfit=misfit,
        penalty=0.0,
        refined=True,
        size=size,
        own_size=size,
    )
