"""A controller that differences its command backwards is found where neither its log nor the model says."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from axis_lab import drive

from fdbench.diagnosis.evidence.prepare import Aligned, aligned
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.model.nominal import Nominal, Simulation
from fdbench.diagnosis.records.runs import COMMAND_RATES
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.search.command_rates import with_likely_rates
from fdbench.effects.dead_time import DeadTime
from fdbench.errors import SpecError
from fdbench.plants.feed_drive import Cascade, FeedDrive
from fdbench.record import Record
from fdbench.simulate.system import Noise, Setup, Timing
from fdbench.virtual_axes.library_axis import Tabulated

PERIOD_S = 1e-3


def fed_forward() -> FeedDrive:
    axis = drive()
    assert isinstance(axis.controller, Cascade)
    controller = dataclasses.replace(axis.controller, acceleration_feedforward_kg=150.0)
    return dataclasses.replace(axis, controller=controller)


def logged(rates: str, seed: int, dead_time_s: float = 0.0, loops: int = 1) -> Record:
    """Return what is logged once in so many cycles of a controller that takes the rates of its command so."""
    cycle_s = PERIOD_S / loops
    position = moves((0.0, 0.06, 0.01, 0.05), (0.08, 0.2), 5.0, cycle_s)[:, 0]
    velocity = COMMAND_RATES[rates](position, cycle_s, 1)
    values = np.column_stack((position, velocity, COMMAND_RATES[rates](velocity, cycle_s, 1)))
    setup = Setup(
        timing=Timing(sampling_time_s=cycle_s, duration_s=len(values) * cycle_s, substeps=-(-10 // loops)),
        motion=Tabulated(values=values),
        noise=Noise(motor_position_m=2e-7, table_position_m=2e-7),
        unmodelled=(DeadTime(dead_time_s=dead_time_s),) if dead_time_s else (),
    )
    system = fed_forward().system(setup)
    system.start([seed])
    rows = system.advance(len(values))[::loops, :, 0]
    columns = {name: rows[:, index] for index, name in enumerate(system.columns)}
    told = {name: own for name, own in columns.items() if not name.startswith(("reference_velocity", "reference_acc"))}
    return Record({"time_s": np.arange(len(rows)) * PERIOD_S, **told}, {}, f"record {seed}")


def found_in(records: Sequence[Record], rates: str | None = None, loops: int = 1) -> Calibrated:
    nominal = Nominal(plant=fed_forward(), simulation=Simulation(substeps=10, loops=loops, command_rates=rates))

    def anew(simulation: Simulation) -> Aligned:
        return aligned(dataclasses.replace(nominal, simulation=simulation), records, [])

    return with_likely_rates(Calibrated.of(anew(nominal.simulation)), anew)


@pytest.mark.parametrize(("rates", "told"), [("central", None), ("backward", None), ("backward", "central")])
def test_backward_differences_of_a_command_are_found_where_nothing_is_told(rates: str, told: str | None) -> None:
    found = found_in([logged(rates, seed) for seed in range(2)], told)
    is_found = rates == "backward" and told is None
    assert found.ready.nominal.simulation.command_rates == ("backward" if is_found else told)
    said = [line for line in found.ready.warnings if "command_rates" in line]
    assert len(said) == is_found
    assert (found.misfit < 1.3) == (rates == "central" or is_found)


@pytest.mark.parametrize("rates", ["central", "backward"])
def test_a_loop_that_answers_late_does_not_decide_how_its_command_is_differenced(rates: str) -> None:
    found = found_in([logged(rates, seed, dead_time_s=8e-4) for seed in range(2)])
    assert found.ready.nominal.simulation.command_rates == ("backward" if rates == "backward" else None)


@pytest.mark.parametrize("rates", ["backward", "central"])
def test_rates_are_late_by_cycles_of_the_controller_and_not_of_the_log(rates: str) -> None:
    found = found_in([logged("backward", seed, loops=4) for seed in range(2)], rates, loops=4)
    assert (found.misfit < 1.2) == (rates == "backward")


def test_rates_are_central_or_backward() -> None:
    with pytest.raises(SpecError, match="command_rates: 'backwards' is none"):
        Simulation(substeps=10, command_rates="backwards")
