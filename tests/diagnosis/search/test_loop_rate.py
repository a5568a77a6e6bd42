"""A loop faster than its log is told from one that is not, by records that a simulator of its own wrote."""

import dataclasses

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.commands import at_each_loop
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.search.loop_rate import Calibrated, at_likely_rate
from fdbench.record import Record
from fdbench.simulate.system import Noise, Setup, Timing
from fdbench.virtual_axes.library_axis import Tabulated

PERIOD_S = 1e-3
NOMINAL = Nominal(plant=drive(), simulation=Simulation(substeps=10))


def logged(loops: int, seed: int) -> Record:
    """Return what is logged once in so many cycles of the controller."""
    reference = moves((0.0, 0.06, 0.01, 0.05), (0.08, 0.2), 5.0, PERIOD_S)
    fine = at_each_loop(reference, PERIOD_S, loops)
    setup = Setup(
        timing=Timing(sampling_time_s=PERIOD_S / loops, duration_s=len(fine) * PERIOD_S / loops, substeps=5),
        motion=Tabulated(values=fine),
        noise=Noise(motor_position_m=2e-7, table_position_m=2e-7),
    )
    system = drive().system(setup)
    system.start([seed])
    rows = system.advance(len(fine))[::loops, :, 0]
    columns = {name: rows[:, index] for index, name in enumerate(system.columns)}
    return Record({"time_s": np.arange(len(rows)) * PERIOD_S, **columns}, {}, f"record {seed}")


@pytest.mark.parametrize(("loops", "told"), [(1, None), (2, None), (4, None), (2, 1)])
def test_a_loop_faster_than_its_log_is_found_where_nothing_is_told(loops: int, told: int | None) -> None:
    nominal = dataclasses.replace(NOMINAL, simulation=Simulation(substeps=10, loops=told))
    ready = aligned(nominal, [logged(loops, seed) for seed in range(2)], [])
    found = at_likely_rate(ready)
    expected = None if loops == 1 else loops
    assert found.ready.nominal.simulation.loops == (expected if told is None else told)
    said = [line for line in found.ready.warnings if "loops" in line]
    assert len(said) == (told is None and loops > 1)
    assert (found.misfit < 1.3) == (told is None)
    if said:
        assert f"loops = {loops}" in said[0]
        assert Calibrated.of(ready).misfit > 2.0 * found.misfit
