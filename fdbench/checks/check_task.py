"""Shared checks of tasks: what every reward must hold, on the first scenario that it fits."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import gymnasium
import numpy as np

from fdbench.checks._data_sheet import check_data_sheet
from fdbench.checks._report import NotApplicable, run_checks
from fdbench.checks.check_env import Subject, actions_of, lanes_equal_single_runs, resets_by_mask, run
from fdbench.envs import environment_ids
from fdbench.envs.tasks import Task
from fdbench.errors import PluginError
from fdbench.scenario import load_scenario

STEPS = 200


@dataclass(frozen=True)
class CheckedTask:
    """A task and the environment on which it is tried."""

    cls: type[Task]

    @cached_property
    def env_id(self) -> str:
        """Id of the first environment that the task fits."""
        for name in environment_ids():
            scenario = load_scenario(name)
            if self.cls.unfit(scenario, scenario.system()) is None:
                return name
        raise NotApplicable("it fits no scenario")

    def subject(self, task: str | None = None) -> Subject:
        """Return the environment with this task, or another one."""
        name, chosen = self.env_id, task or self.cls.name
        return Subject(
            f"{name}, {chosen}",
            lambda: gymnasium.make(name, task=chosen).unwrapped,
            lambda n: gymnasium.make_vec(name, num_envs=n, task=chosen),
            None,
        )


def is_documented(case: CheckedTask) -> None:
    """Equation, unit, source and a worked example, which is right, are in the docstring."""
    check_data_sheet(case.cls, (".. math::", "Unit:", "Source:", ">>> "))


def rewards_are_finite(case: CheckedTask) -> None:
    """Every reward is a finite float, and not always the same."""
    env = case.subject().make()
    rewards = [step[1] for step in run(env, 0, actions_of(env, STEPS))[1:]]
    if not all(type(reward) is float and np.isfinite(reward) for reward in rewards):
        raise PluginError(f"a reward is no finite float: {next(r for r in rewards if type(r) is not float)!r}.")
    if len(set(rewards)) == 1:
        raise PluginError(f"{STEPS} random actions have one reward, {rewards[0]:g}.")


def leaves_the_machine_alone(case: CheckedTask) -> None:
    """Observe what every other task observes."""
    observed = []
    for task in (None, "tracking"):
        env = case.subject(task).make()
        observed.append(np.array([step[0] for step in run(env, 0, actions_of(env, STEPS))]))
    if not np.array_equal(observed[0], observed[1]):
        raise PluginError("the observations are not those of the task 'tracking'.")


def lanes_have_the_same_rewards(case: CheckedTask) -> None:
    """Lanes side by side have the rewards of single environments, bit for bit, also after a reset of some."""
    lanes_equal_single_runs(case.subject())
    resets_by_mask(case.subject())


CHECKS: tuple[Callable[[CheckedTask], None], ...] = (
    is_documented,
    rewards_are_finite,
    leaves_the_machine_alone,
    lanes_have_the_same_rewards,
)


def check_task(cls: type[Task]) -> list[str]:
    """Run all checks on a task and return a line for each.

    Raises
    ------
    PluginError
        If a check fails.
    """
    case = CheckedTask(cls)
    return run_checks(cls.name, [(check.__name__, partial(check, case)) for check in CHECKS])
