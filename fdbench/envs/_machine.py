"""Machines of a scenario as an environment needs them: one for each seed, quickly, and the same one undisturbed."""

import dataclasses
from dataclasses import dataclass, field
from typing import final

from fdbench.errors import SpecError
from fdbench.motions import Motion, Reference
from fdbench.scenario import Scenario
from fdbench.simulate.axis import Axis
from fdbench.simulate.stage import StageSystem
from fdbench.simulate.system import Noise, System

DRAWN = ("plant.", "reality.", "start.")
Lanes = Axis | StageSystem


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
        self._paths = [path for draw in scenario.draw for path in draw.values]
        refused = [path for path in self._paths if not path.startswith(DRAWN)]
        if refused:
            raise SpecError(
                f"{scenario.id}: draw: an environment has one command and one clock; '{refused[0]}' cannot be drawn "
                "in it, only what begins with plant., reality. or start."
            )

    @property
    def drawn(self) -> bool:
        """Whether every seed is another machine."""
        return bool(self.scenario.draw)

    @property
    def reference(self) -> Reference:
        """The motion before the start displaces it, (n_samples, 3 n_axes)."""
        timing = self.scenario.setup.timing
        return self.motion.reference(timing.sampling_time_s, timing.n_samples)

    def of(self, seed: int) -> Scenario:
        """Return the scenario with the machine of a seed; without draws, the scenario."""
        return self.scenario.drawn(seed)

    def system(self, machine: Scenario, n_lanes: int = 1) -> System:
        """Return instances of a machine as it really is."""
        return machine.plant.system(dataclasses.replace(machine.setup, motion=self.motion), n_lanes)

    def lanes(self, system: System) -> Lanes:
        """Return a system whose lanes can be the machines of different seeds, or raise a SpecError.

        A feed drive is a column of a block as a whole; of a servo stage only the start is, its response is for all.
        """
        shared = [path for path in self._paths if not path.startswith("start.")]
        if isinstance(system, Axis) or (isinstance(system, StageSystem) and not shared):
            return system
        raise SpecError(
            f"{self.scenario.id}: lanes side by side have one {self.scenario.plant.name}, and this scenario draws "
            f"another for each seed, by '{(shared or self._paths)[0]}'. gymnasium.make_vec(..., "
            "vectorization_mode='sync') steps its environments in turns."
        )

    def undisturbed(self, machine: Scenario) -> System:
        """Return one instance of a machine without process forces, random effects and noise."""
        effects = tuple(effect for effect in machine.reality.effects if not (effect.disturbance or effect.random))
        quiet = dataclasses.replace(machine.setup, motion=self.motion, noise=Noise(), unmodelled=effects)
        return machine.plant.system(quiet)


def put(system: Lanes, lane: int, machine: Lanes) -> None:
    """Make a lane another machine of the same kind: it is a column of a block, and nothing else."""
    block, place = divmod(lane, system.initial.shape[-1])
    system.initial[block, ..., place] = machine.initial[0, ..., 0]
