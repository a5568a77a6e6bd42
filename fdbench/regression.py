"""The nominal plant as a linear model, and its rows one by one."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NO_READINGS: FloatArray = np.empty(0)
NO_READINGS.flags.writeable = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    r"""The nominal plant as a model that is linear in its parameters, :math:`y = Z \beta + f + \varepsilon`.

    Attributes
    ----------
    regressors : (n_rows, n_parameters) array
        Z, one column for each parameter.
    target : (n_rows,) array
        y, the quantity that ``Estimate.output`` predicts.
    names : tuple of str
        Names of the parameters, with their units.
    target_name : str
        Name of y, with its unit.
    time_s : (n_rows,) array
        Time of each row.
    rows : (n_rows,) array of int
        Sample of the record that each row belongs to.
    disturbance_gain : float
        f in units of y for one newton of disturbance (a force against positive motion).
    readings : (n_rows, n_inputs + n_outputs) array or None
        What an observer takes in, where the plant has a model for one: the inputs held over the row's sampling time,
        then the outputs at its end, as `fdbench.plants.StateSpace` names them.
    """

    regressors: FloatArray
    target: FloatArray
    names: tuple[str, ...]
    target_name: str
    time_s: FloatArray
    rows: NDArray[np.intp]
    disturbance_gain: float
    readings: FloatArray | None = None

    @property
    def sampling_time_s(self) -> float:
        """Time between two rows that follow each other; rows may have gaps, such as segments left out."""
        stride = float(np.median(np.diff(self.rows)))
        return float((self.time_s[-1] - self.time_s[0]) / (self.rows[-1] - self.rows[0]) * stride)


class Sample(NamedTuple):
    """One row of a regression, as a streaming estimator meets it."""

    time_s: float
    regressors: FloatArray
    target: float
    disturbance_gain: float
    readings: FloatArray = NO_READINGS


def samples(regression: Regression) -> list[Sample]:
    """Return the rows of a regression as samples, in order of time."""
    n, gain = len(regression.target), regression.disturbance_gain
    readings = np.empty((n, 0)) if regression.readings is None else regression.readings
    return [
        Sample(float(time), row, float(target), gain, reading)
        for time, row, target, reading in zip(
            regression.time_s, regression.regressors, regression.target, readings, strict=True
        )
    ]
