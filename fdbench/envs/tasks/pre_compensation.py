"""Shape the commanded positions so that the tool keeps to the path."""

from typing import Any, final

import numpy as np

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._squared import MICROMETRE, SquaredDeviation
from fdbench.envs.tasks._task import rewarded_columns
from fdbench.scenario import Scenario
from fdbench.simulate.system import FloatArray, System


@final
class PreCompensation(SquaredDeviation):
    r"""Minus the squared error that a workpiece shows: two axes their contour error, one axis that of its table.

    .. math:: r_k = -\varepsilon_k^2, \qquad
              \varepsilon = -(x^{ref} - x) \sin\theta + (y^{ref} - y) \cos\theta, \quad
              \theta = \operatorname{atan2}(\dot y^{ref}, \dot x^{ref})

    for two axes: :math:`\varepsilon` is the distance to the tangent of the path at the reference, and running late
    along the path costs nothing. One axis has :math:`\varepsilon = x^{ref} - x_t` with the position of the table where
    it is read, else with that of the motor. Unit: :math:`\mu m^2`. At rest, theta is that of the motion before, or of
    the first one.

    Validity: commanded positions are what an action adds to. The tangent stands for the path where the servo error is
    small beside the radius R of the path; it is wrong by about (error along the path)^2 / 2 R.

    Source: Koren and Lo, Variable-gain cross-coupling controller for contouring, CIRP Annals 40 (1991), 371-374,
    for the contour error; Chou, Duan, Okwudire, CIRP Annals, for pre-compensation.

    Examples
    --------
    30 um beside the path costs 900 um^2, 30 um behind on it nothing.

    >>> from fdbench.envs.drive_env import DriveEnv
    >>> env = DriveEnv("ServoSpiral-v0", task="pre_compensation")
    >>> task, k = env.interface.task, 2000
    >>> c, s = task.tangents[k].tolist()
    >>> row = dict.fromkeys(env.system.columns, 0.0)
    >>> for along, beside in ((0.0, 3e-5), (-3e-5, 0.0)):
    ...     row["x_position_m"], row["y_position_m"] = along * c - beside * s, along * s + beside * c
    ...     print(f"{-task.reward(k, list(row.values()), [0.0, 0.0]):.6f}")
    900.000000
    0.000000
    """

    unit = "um^2"

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        super().__init__(machines, system, n_lanes)
        references = rewarded_columns(machines.scenario, system)
        if len(references) == 1 and "table_position_m" in system.columns:
            references = {"table_position_m": "reference_position_m"}
        self.follow(references, MICROMETRE)
        if len(references) == 2:
            # Those of the motion before it is displaced: lanes that begin elsewhere have the same, to the bit.
            self.tangents = tangents(machines.reference[:, ::3])
            self._across = [self.series(-self.tangents[:, 1]), self.series(self.tangents[:, 0])]

    @classmethod
    def unfit(cls, scenario: Scenario, system: System) -> str | None:
        columns = rewarded_columns(scenario, system)
        if any(not name.endswith("position_m") for name in (*system.action_names, *columns)):
            return f"an action adds to {', '.join(system.action_names)}, not to a commanded position"
        return None

    def reward(self, k: Any, row: Any, action: Any) -> Any:
        if len(self.logged) == 1:
            return super().reward(k, row, action)
        error = 0.0
        for (factor, wanted, place), across in zip(self.logged, self._across, strict=True):
            error += across[k] * (factor * (row[wanted] - row[place]))
        return -(error * error)


def tangents(path: FloatArray) -> FloatArray:
    """Return the direction of a path, (n_samples, 2), from its points, (n_samples, 2).

    >>> tangents(np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 2.0], [0.0, 2.0]]))[:, 1]
    array([1., 1., 1., 1.])
    """
    steps = np.gradient(path, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    moving = length > 0.0
    last = np.maximum.accumulate(np.where(moving, np.arange(len(path)), -1))
    last[last < 0] = np.argmax(moving)
    return np.asarray(steps[last] / np.where(moving, length, 1.0)[last, None])
