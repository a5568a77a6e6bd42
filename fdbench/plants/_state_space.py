"""The linear model ``state_space``: no linear parameters, but readings for an observer."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.plants._plant import LinearModel, StateSpace, StateSpacePlant
from fdbench.record import Record
from fdbench.regression import Regression


@final
@dataclass(frozen=True, kw_only=True)
class StateSpaceModel(LinearModel):
    """First output at the end of each sampling time as target, with the readings of an observer.

    Row k lasts from sample k to sample k + 1: its readings are the inputs u_k and the outputs y_{k+1}.

    Attributes
    ----------
    plant : StateSpacePlant
    disturbance_gain : callable
        What a force of one newton adds to the target, from the `StateSpace` and the sampling time (s).
    """

    plant: StateSpacePlant
    disturbance_gain: Callable[[StateSpace, float], float]
    name: str = "state_space"

    def regression(self, record: Record) -> Regression:
        """Return the target and the readings, without regressors."""
        space = self.plant.state_space(record.sampling_time_s)
        inputs = [record[name][:-1] for name in space.inputs]
        outputs = [record[name][1:] for name in space.outputs]
        n = record.n_samples - 1
        return Regression(
            regressors=np.empty((n, 0)),
            target=outputs[0],
            names=(),
            target_name=space.outputs[0],
            time_s=record["time_s"][:-1],
            rows=np.arange(n),
            disturbance_gain=self.disturbance_gain(space, record.sampling_time_s),
            readings=np.column_stack(inputs + outputs),
        )
