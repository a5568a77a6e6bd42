"""Machines of a scenario as an environment needs them: one for each seed, quickly, and the same one undisturbed."""

import dataclasses
from dataclasses import dataclass, field
from typing import final

from fdbench.errors import SpecError
from fdbench.motions import Motion, Reference
from fdbench.scenario import Scenario
from fdbench.simulate.axis import Axis
from fdbench.simulate.system import Noise, System

DRAWN = ("plant.", "reality.", "start.")


@final
@dataclass(frozen=True, eq=False)
class Remembered(Motion):
    """A motion whose references are kept: they take longer than all the rest of another machine."""

    motion: Motion
    known: dict[tuple[float, int], Reference] = field(default_factory=dict)

    def reference(self, period_s: float, n_samples: int) -> Reference:
        """Return what the motion returned before, or returns now."""
        if (period_s, n_samples) not in self.known:
            self.known[period_s, n_samples] = self.motion.reference(period_s, n_samples)
        return self.known[period_s, n_samples]


class Machines:
    """The machines of a scenario: that of its data sheet, and one for each seed where some are drawn.

    Parameters
    ----------
    scenario : Scenario

    Raises
    ------
    SpecError
        If it draws more than the plant, its reality and its start: an episode would have another clock or command.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.motion = Remembered(scenario.setup.motion)
        paths = [path for draw in scenario.draw for path in draw.values if not path.startswith(DRAWN)]
        if paths:
            raise SpecError(
                f"{scenario.id}: draw: an environment has one command and one clock; '{paths[0]}' cannot be drawn "
                "in it, only what begins with plant., reality. or start."
            )

    @property
    def drawn(self) -> bool:
        """Whether every seed is another machine."""
        return bool(self.scenario.draw)

    @property
    def displaced(self) -> bool:
        """Whether every seed has a reference of its own, one from another position."""
        return any(path.startswith("start.position_m") for draw in self.scenario.draw for path in draw.values)

    def of(self, seed: int) -> Scenario:
        """Return the scenario with the machine of a seed; without draws, the scenario."""
        return self.scenario.drawn(seed)

    def system(self, machine: Scenario, n_lanes: int = 1) -> System:
        """Return instances of a machine as it really is."""
        return machine.plant.system(dataclasses.replace(machine.setup, motion=self.motion), n_lanes)

    def axis(self, machine: Scenario) -> Axis:
        """Return one instance of a machine that is a feed drive."""
        system = self.system(machine)
        if not isinstance(system, Axis):
            raise SpecError(f"{self.scenario.id}: a {machine.plant.name} is no feed drive.")
        return system

    def undisturbed(self, machine: Scenario) -> System:
        """Return one instance of a machine without process forces, random effects and noise."""
        effects = tuple(effect for effect in machine.reality.effects if not (effect.disturbance or effect.random))
        quiet = dataclasses.replace(machine.setup, motion=self.motion, noise=Noise(), unmodelled=effects)
        return machine.plant.system(quiet)


def put(system: Axis, lane: int, machine: Axis) -> None:
    """Make a lane another machine of the same kind: a machine is a column of a block, and nothing else."""
    block, place = divmod(lane, system._side_by_side)
    system._initial.values[block, :, place] = machine._initial.values[0, :, 0]
