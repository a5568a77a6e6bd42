"""A loop faster than its log is told from one that is not, by records that a simulator of its own wrote."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.prepare import Aligned, aligned
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.commands import at_each_loop
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.search.loop_rate import at_likely_rate
from fdbench.plants.feed_drive import Following
from fdbench.record import Record
from fdbench.simulate.system import Noise, Setup, Timing
from fdbench.virtual_axes.library_axis import Tabulated

PERIOD_S = 1e-3
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))


def logged(loops: int, seed: int, noise_m: float = 2e-7) -> Record:
    """Return what is logged once in so many cycles of the controller."""
    reference = moves((0.0, 0.06, 0.01, 0.05), (0.08, 0.2), 5.0, PERIOD_S)
    fine = at_each_loop(reference, PERIOD_S, loops)
    setup = Setup(
        timing=Timing(sampling_time_s=PERIOD_S / loops, duration_s=len(fine) * PERIOD_S / loops, substeps=5),
        motion=Tabulated(values=fine),
        noise=Noise(motor_position_m=noise_m, table_position_m=noise_m),
    )
    system = drive().system(setup)
    system.start([seed])
    rows = system.advance(len(fine))[::loops, :, 0]
    columns = {name: rows[:, index] for index, name in enumerate(system.columns)}
    return Record({"time_s": np.arange(len(rows)) * PERIOD_S, **columns}, {}, f"record {seed}")


def found_in(nominal: Nominal, records: Sequence[Record]) -> Calibrated:
    def anew(simulation: Simulation) -> Aligned:
        return aligned(dataclasses.replace(nominal, simulation=simulation), records, [])

    return at_likely_rate(Calibrated.of(anew(nominal.simulation)), anew)


@pytest.mark.parametrize(("loops", "told"), [(1, None), (2, None), (4, None), (2, 1)])
def test_a_loop_faster_than_its_log_is_found_where_nothing_is_told(loops: int, told: int | None) -> None:
    nominal = dataclasses.replace(NOMINAL, simulation=Simulation(substeps=10, loops=told))
    records = [logged(loops, seed) for seed in range(2)]
    ready = aligned(nominal, records, [])
    found = found_in(nominal, records)
    expected = None if loops == 1 else loops
    assert found.ready.nominal.simulation.loops == (expected if told is None else told)
    said = [line for line in found.ready.warnings if "loops" in line]
    assert len(said) == (told is None and loops > 1)
    assert (found.misfit < 1.3) == (told is None)
    if said:
        assert f"loops = {loops}" in said[0]
        assert Calibrated.of(ready).misfit > 2.0 * found.misfit


@pytest.mark.parametrize("loops", [1, 2, 4])
def test_without_a_controller_the_rate_is_told_by_how_early_the_force_acts(loops: int) -> None:
    """A force that acts for half of the sampling time, and then another, is early by a quarter of it."""
    nominal = dataclasses.replace(NOMINAL, plant=dataclasses.replace(NOMINAL.drive, controller=Following()))
    found = found_in(nominal, [logged(loops, seed, 5e-8) for seed in range(3)])
    assert (found.ready.nominal.simulation.loops is None) == (loops == 1)
    assert found.misfit < 1.3
    assert found.ready.nominal.cycles == 1
