"""Rewards that are squared deviations of readings from a series."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.envs._machine import Machines
from fdbench.envs.tasks._task import Series, Task
from fdbench.simulate.system import FloatArray, System
from fdbench.units import split_unit

# Of a micrometre and a millimetre a second in SI units: deviations of drives are then numbers about 1.
PER_UNIT = {"m": 1e6, "m_per_s": 1e3}
MICROMETRE = PER_UNIT["m"]


def per_unit(column: str) -> float:
    """Return the factor from the column's SI unit to micrometres or millimetres a second, 1 for others."""
    return PER_UNIT.get(split_unit(column)[1], 1.0)


class SquaredDeviation(Task):
    """Minus the sum of squared deviations of readings; what is wanted of them is filled in by a subclass.

    Attributes
    ----------
    targets : sequence of (float, Series, int)
        Factor, series that is wanted, and place of the reading in a row.
    logged : sequence of (float, int, int)
        Factor, place in a row of what is wanted, such as a reference that each lane has elsewhere, and of the reading.
    """

    def __init__(self, machines: Machines, system: System, n_lanes: int | None) -> None:
        super().__init__(machines, system, n_lanes)
        self.targets: Sequence[tuple[float, Any, int]] = ()
        self.logged: Sequence[tuple[float, int, int]] = ()
        self._only: tuple[float, int, int] | None = None

    def reward(self, k: Any, row: Any, action: Any) -> Any:
        if self._only is not None:  # most drives, of which every step asks
            factor, wanted, place = self._only
            error = factor * (row[wanted] - row[place])
            return 0.0 - error * error
        reward = 0.0
        for factor, series, place in self.targets:
            error = factor * (series[k] - row[place])
            reward -= error * error
        for factor, wanted, place in self.logged:
            error = row[wanted] - row[place]
            if factor != 1.0:  # of many lanes a product costs as much as any
                error = factor * error
            reward -= error * error
        return reward

    def follow(self, references: Mapping[str, str], factor: float) -> None:
        """Want readings at their references, which are in the row where the system logs them."""
        columns, commanded = self.system.columns, self.system.commanded
        pairs = references.items()
        self.logged = [(factor, columns.index(b), columns.index(a)) for a, b in pairs if b in columns]
        self.targets = [self.target(a, commanded[b], factor) for a, b in pairs if b not in columns]
        self._only = self.logged[0] if len(self.logged) == len(pairs) == 1 else None

    def target(self, column: str, values: FloatArray, factor: float) -> tuple[float, Series, int]:
        """Return a target for `targets`."""
        return factor, self.series(values), self.system.columns.index(column)


class PerLane:
    """Series of lanes, each its own, that are asked for one sample of each lane."""

    def __init__(self, n_samples: int, n_lanes: int) -> None:
        self.values, self._lanes = np.zeros((n_samples, n_lanes)), np.arange(n_lanes)

    def __getitem__(self, k: Any) -> FloatArray:
        found: FloatArray = self.values[k, self._lanes]
        return found
