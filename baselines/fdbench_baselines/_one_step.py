"""What the equation of a nominal plant leaves of each reading: the linear model of a drive that has no parameters."""

from dataclasses import replace

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression
from fdbench.plants import StateSpacePlant

MODEL = "state_space"


class OneStep:
    r"""The first output a sampling time ahead, from the readings before it.

    .. math:: \hat y_{k+1} = c_1 (A_d C^+ y_k + B_d u_k), \qquad y_{k+1} - \hat y_{k+1} = g\, d_k + \varepsilon_k

    C^+ weighs each output by its noise; the noise of a reading enters two rows with opposite signs.

    Parameters
    ----------
    plant : StateSpacePlant
    sampling_time_s : float

    Attributes
    ----------
    from_outputs, from_inputs : (n_outputs,), (n_inputs,) arrays
        What the prediction is multiplied from.
    """

    def __init__(self, plant: StateSpacePlant, sampling_time_s: float) -> None:
        from scipy.linalg import expm

        space = plant.state_space(sampling_time_s)
        n, m = space.B.shape
        generator = np.zeros((n + m, n + m))
        generator[:n, :n], generator[:n, n:] = space.A, space.B
        flow = expm(generator * sampling_time_s)
        weight = 1.0 / np.sqrt(space.output_variances)
        self.from_outputs: FloatArray = space.C[0] @ flow[:n, :n] @ np.linalg.pinv(space.C * weight[:, None]) * weight
        self.from_inputs: FloatArray = space.C[0] @ flow[:n, n:]

    def predicted(self, before: FloatArray | None, readings: FloatArray) -> FloatArray:
        """Return the predictions (n,) of rows of readings (n, n_inputs + n_outputs).

        ``before`` are the readings of the row before the first, which without it is predicted as it is read.
        """
        m = len(self.from_inputs)
        outputs = readings[:, m:]
        first = outputs[:1] if before is None else before[np.newaxis, m:]
        result = np.concatenate((first, outputs[:-1])) @ self.from_outputs + readings[:, :m] @ self.from_inputs
        if before is None:
            result[0] = outputs[0, 0]
        return np.asarray(result)


def declined(context: Context) -> str | None:
    """Return why there is neither a linear model with parameters nor one of a single step, or None."""
    if context.nominal:
        return None
    if context.model != MODEL or not isinstance(context.plant, StateSpacePlant):
        return "the plant's model has no parameters"
    C = context.plant.state_space(context.sampling_time_s).C
    if np.linalg.matrix_rank(C / np.abs(C).max(axis=0, initial=1e-300)) < C.shape[1]:
        return "the readings of a sample do not give every state of the plant"
    return None


def residual_model(context: Context, regression: Regression) -> tuple[Regression, FloatArray | None]:
    """Return the linear model with what the equation leaves as target, and the predictions; others as they are."""
    if regression.names or regression.readings is None or not isinstance(context.plant, StateSpacePlant):
        return regression, None
    step = OneStep(context.plant, context.sampling_time_s)
    predicted = step.predicted(None, regression.readings)
    return replace(regression, target=regression.target - predicted), predicted
