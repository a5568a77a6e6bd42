"""Blocks of instances of an axis: the rows of `layout`, and behind them flags, parameters and states of its effects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.effects import Effect
from fdbench.simulate import layout
from fdbench.simulate.exponential import exponential
from fdbench.simulate.memory import aligned_zeros
from fdbench.simulate.ports import block_rows, slots
from fdbench.simulate.system import FloatArray

ROW = {name: index for index, name in enumerate(layout.ROWS)}
MECHANICS_ROWS = np.arange(ROW["HALF_0"], ROW["VELOCITY_LIMIT"] + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mechanics:
    r"""Linear part of an axis, :math:`\dot s = A s + B f` with s = (x_m, v_m, x_t, v_t) and f = (f_motor, f_table).

    A rigid axis has equal rows for motor side and table. Limits in m and m/s; stiffness in N/m, damping in N s/m.
    """

    A: FloatArray
    B: FloatArray
    stiffness_N_per_m: float
    damping_N_s_per_m: float
    rigid: bool
    position_limit_m: float
    velocity_limit_m_per_s: float

    def propagators(self, h: float) -> FloatArray:
        """Return the 24 entries of (A | B), row by row, that advance the state exactly by h under constant forces."""
        generator = np.zeros((6, 6), dtype=np.result_type(self.A, self.B))
        generator[:4, :4] = self.A
        generator[:4, 4:] = self.B
        flow: FloatArray = exponential(generator * h)[:4]
        return flow.ravel()

    @lru_cache(maxsize=4096)  # noqa: B019 - many instances have the same mechanics
    def rows(self, h: float) -> FloatArray:
        """Return the part of a block that belongs to the mechanics, for substeps of h."""
        limits = self.position_limit_m, self.velocity_limit_m_per_s
        scalars = self.stiffness_N_per_m, self.damping_N_s_per_m, float(self.rigid), *limits
        return np.concatenate((self.propagators(h / 2), self.propagators(h), scalars))


class Blocks:
    """Instances of an axis with the same kinds of effects, lanes side by side; all start with zeros and effects off.

    ``lanes`` are (n_chosen,) arrays of int everywhere; by default all, those that only fill the last block included.

    Parameters
    ----------
    effects : tuple of Effect classes
    n_lanes, width : int
        Lanes, and how many of them lie side by side.

    Attributes
    ----------
    values : (n_blocks, n_rows, width) array
    """

    def __init__(self, effects: tuple[type[Effect], ...], n_lanes: int, width: int) -> None:
        self.slots = slots(effects)
        self.values = aligned_zeros(-(-n_lanes // width), block_rows(effects), width)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.values = aligned_zeros(*self.values.shape)  # a copy begins anywhere
        self.values[:] = state["values"]

    @property
    def flat(self) -> FloatArray:
        """The blocks as a stepper takes them, (n_blocks, n_rows * width)."""
        return self.values.reshape(len(self.values), -1)

    def write(
        self, rows: Sequence[int] | NDArray[np.intp], values: FloatArray, lanes: NDArray[np.intp] | None = None
    ) -> None:
        """Write rows: (n_rows,) values for all lanes alike, or (n_rows, n_chosen) ones."""
        places = np.arange(len(self.values) * self.values.shape[2]) if lanes is None else np.asarray(lanes)
        block, place = np.divmod(places, self.values.shape[2])
        table = np.asarray(values, dtype=np.float64)
        self.values[block, np.asarray(rows)[:, None], place] = table[:, None] if table.ndim == 1 else table

    def set_scalars(self, values: Mapping[str, float], lanes: NDArray[np.intp] | None = None) -> None:
        """Set rows by their names in the layout, such as those of a controller."""
        self.write([ROW[name] for name in values], np.array(list(values.values())), lanes)

    def set_mechanics(self, mechanics: Mechanics, h: float, lanes: NDArray[np.intp] | None = None) -> None:
        """Set propagators, screw and limits for substeps of h."""
        self.write(MECHANICS_ROWS, mechanics.rows(h), lanes)

    def set_effect(self, number: int, effect: Effect, on: bool = True, lanes: NDArray[np.intp] | None = None) -> None:
        """Set the parameters of an effect, by its place among the effects, and switch it on or off."""
        flag, values = self.slots[number].flag, np.array([float(on), *effect.values()])
        self.write(flag + np.arange(len(values)), values, lanes)

    def place(
        self, position_m: float, velocity_m_per_s: float, period_s: float, lanes: NDArray[np.intp] | None = None
    ) -> None:
        """Let an axis be in motion at a constant velocity, with the readings that it has made of that."""
        now, step = position_m, period_s * velocity_m_per_s
        state = {"X_M": now, "X_T": now, "V_M": velocity_m_per_s, "V_T": velocity_m_per_s, "BACK_1": now - step}
        read = {"BACK_2": now - 2.0 * step, "FILTERED": velocity_m_per_s, "LAST_MOTOR": now, "LAST_TABLE": now}
        self.set_scalars({**state, **read}, lanes)


def by_blocks(step: Callable[[FloatArray], None], rows: FloatArray, n_blocks: int, width: int) -> None:
    """Fill rows (n, n_columns, n_lanes) by a step that writes (n, n_columns, n_blocks, width), full blocks in place."""
    shape, n_lanes = (*rows.shape[:2], n_blocks, width), rows.shape[2]
    if n_lanes == n_blocks * width:
        step(rows.reshape(shape))
        return
    raw = np.empty(shape)
    step(raw)
    rows[:] = raw.reshape(*rows.shape[:2], -1)[:, :, :n_lanes]
