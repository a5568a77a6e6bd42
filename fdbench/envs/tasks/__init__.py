"""What an environment rewards: one task, one file."""

from fdbench.envs.tasks._task import Task, fitting, tasks

__all__ = ["Task", "fitting", "tasks"]
