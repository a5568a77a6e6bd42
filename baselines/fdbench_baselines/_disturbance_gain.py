"""What the parameters of a velocity loop say of its mass, by which what is left of a row becomes a force."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression

STEP = 1e-4


class Gain(NamedTuple):
    """Disturbance gain, and its relative standard deviation."""

    gain: float
    deviation: float


class MassShare(NamedTuple):
    """Logarithm of the mass over the sheet's for one unit of each parameter (p,), and its standard deviation."""

    weights: FloatArray
    deviation: float


def disturbance_gain(context: Context, regression: Regression, beta: FloatArray) -> Gain:
    r"""Return the disturbance gain after the record: that of the mass that sheet and parameters make likeliest.

    .. math::
        C \approx \sum_i \sigma_i^2 J_i J_i^T, \quad J_i = \frac{\partial \beta}{\partial \log \theta_i}, \qquad
        E\Big[\log \frac{m}{m_0}\Big] = \sigma_m^2 J_m^T C^{-1} (\beta - \beta_0), \quad
        \mathrm{var} = \sigma_m^2 (1 - \sigma_m^2 J_m^T C^{-1} J_m)

    with mass, loop gain, viscous and Coulomb friction for :math:`\theta`. The record tells their ratios alone, but the
    sheet's covariance C how much of an unexpected ratio is the mass's. Without C, or in another model, the gain is
    nominal.

    Parameters
    ----------
    context, regression : Context, Regression
    beta : (p,) array
        Parameters of the record, in the model's order.

    Examples
    --------
    A drive that answers 5 % weaker is 4 % heavier where the mass is left open by 4.4 % and the gain by 1.8 %.

    >>> from fdbench.scenario import load_scenario
    >>> context = load_scenario("ShakerConstant-v1").context()
    >>> regression = context.regression(load_scenario("ShakerConstant-v1").record(0))
    >>> nominal = np.array(list(context.nominal.values()))
    >>> found = disturbance_gain(context, regression, nominal * [0.95, 1.0, 1.0, 1.0] + [0.0, 0.0417, 0.0, 0.0])
    >>> round(found.gain / regression.disturbance_gain, 3), round(found.deviation, 3)
    (0.958, 0.016)
    """
    share = mass_share(context)
    moved = float(share.weights @ (beta - np.array(list(context.nominal.values()))))
    return Gain(regression.disturbance_gain * float(np.exp(-moved)), share.deviation)


def mass_share(context: Context) -> MassShare:
    """Return what the parameters' distance from the sheet says of the mass; see `disturbance_gain`."""
    from scipy.optimize import nnls

    from fdbench.plants._velocity_loop import VelocityLoopModel

    model, period_s = context.linear_model, context.sampling_time_s
    if context.covariance is None or not isinstance(model, VelocityLoopModel):
        return MassShare(np.zeros(len(context.nominal)), 0.0)
    line, more = model.line, 1.0 + STEP
    moved = (
        replace(model, mass_kg=model.mass_kg * more),
        replace(model, gain_N_s_per_m=model.gain_N_s_per_m * more),
        replace(model, line=replace(line, viscous_N_s_per_m=line.viscous_N_s_per_m * more)),
        replace(model, line=replace(line, coulomb_N=line.coulomb_N * more)),
    )
    nominal = np.array(list(context.nominal.values()))
    # The sum of beta_1 and beta_2, the drive's pole, is known far better than either.
    turn = np.eye(len(nominal))
    turn[1, 0] = 1.0
    size = np.sqrt(np.diag(turn @ context.covariance @ turn.T))
    turn = turn / size[:, None]
    J = turn @ np.array([(list(other.nominal_parameters(period_s).values()) - nominal) / STEP for other in moved]).T
    squares = np.column_stack([np.outer(column, column).ravel() for column in J.T])
    variances = nnls(squares, (turn @ context.covariance @ turn.T).ravel())[0]
    weight = variances[0] * np.linalg.lstsq((J * variances) @ J.T, J[:, 0], rcond=1e-10)[0]
    spread = float(variances[0] * (1.0 - weight @ J[:, 0]))
    return MassShare(weight @ turn, float(np.sqrt(max(spread, 0.0))))
