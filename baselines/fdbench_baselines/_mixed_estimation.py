r"""Mixed estimation: what a record and a data sheet say of a drive's parameters, put together.

The record says :math:`\hat\beta \sim N(\beta + \tau J q, V)`, the sheet :math:`\beta \sim N(\beta_0, C)`. A process
force whose mean grows with the feed, or acts against it, cannot be told from friction by any record: its directions J
in the parameters are doubted by as much as sheet and record disagree.

References
----------
Theil and Goldberger, On pure and mixed statistical estimation in economics, International Economic Review 2 (1961),
65-78; MacKay, Bayesian interpolation, Neural Computation 4 (1992), for the evidence of :math:`\tau`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import Context, FloatArray, Regression
from fdbench_baselines._straight_friction import DIRECTIONS, straight

# A process force at constant feed goes to Coulomb friction, one that grows with it to viscous friction or, in a loop
# whose equation holds the command, to the command's gain.
CONFOUNDED = {
    "velocity_loop": (("beta_1",), ("beta_3", "beta_4")),
    "inverse_dynamics": (("viscous_friction_N_s_per_m",), ("coulomb_friction_N",)),
    "directional_inverse_dynamics": (
        ("viscous_friction_positive_N_s_per_m", "viscous_friction_negative_N_s_per_m"),
        ("coulomb_friction_positive_N", "coulomb_friction_negative_N"),
    ),
}
SCALES = np.geomspace(1e-2, 1e3, 61)
DECISIVE = 10.0  # ratio of evidences from which a process force is held to exist; strong, on the scale of Jeffreys


class Found(NamedTuple):
    """Parameters (p,) and their covariance (p, p)."""

    beta: FloatArray
    covariance: FloatArray


def applies(context: Context) -> bool:
    """Return whether the model is that of a drive whose data sheet says how exact it is; published trials do not."""
    return context.covariance is not None and context.model in CONFOUNDED


def learnable(context: Context, regressors: FloatArray) -> NDArray[np.bool_]:
    """Return which rows (n,) a drive's parameters are learnt from: of inverse dynamics with a sheet, straight ones.

    The filters of inverse dynamics smear a reversal over many rows; those of a velocity loop are single samples.
    """
    if applies(context) and context.model in DIRECTIONS:
        return straight(context, regressors)
    return np.ones(len(regressors), dtype=np.bool_)


def mixed(context: Context, regression: Regression, record: Found) -> Found:
    r"""Return the mean and covariance of the parameters after both.

    .. math::
        \beta = \beta_0 + K (\hat\beta - \beta_0), \quad K = C S^{-1}, \quad S = C + V + \tau^2 J J^T, \quad
        \mathrm{cov} = C - K C, \qquad \hat\tau = \arg\max_\tau N(\hat\beta;\, \beta_0, S)

    Columns of J move the output by the same root mean square. :math:`\tau = 0` without a process (no period), and
    unless another makes the record ten times as likely.

    >>> from fdbench.scenario import load_scenario
    >>> scenario = load_scenario("MillingUpDown-v1")
    >>> context, regression = scenario.context(), scenario.context().regression(scenario.record())
    >>> beta = np.array(list(context.nominal.values()))
    >>> exact = Found(beta + 0.01 * np.array([0.0, 1.0]), 1e-12 * np.eye(2))
    >>> found = mixed(context, regression, exact)  # what beta_1 says is doubted, what the sheet says of the sum is kept
    >>> (found.beta - beta).round(3)
    array([-0.01,  0.01])
    """
    if context.covariance is None:
        return record
    in_order = list(context.nominal)
    place = [in_order.index(name) for name in regression.names]
    nominal = np.array(list(context.nominal.values()))[place]
    sheet = context.covariance[np.ix_(place, place)]
    size = np.sqrt(np.mean(regression.regressors**2, axis=0))
    size[size == 0.0] = 1.0
    # In units of what each parameter moves, a matrix with kilograms and newtons has eigenvalues that can be compared.
    C, V = sheet * np.outer(size, size), record.covariance * np.outer(size, size)
    moved = weighed((record.beta - nominal) * size, C, V, directions(context, regression.names))
    return Found(nominal + moved.beta / size, moved.covariance / np.outer(size, size))


def directions(context: Context, names: tuple[str, ...]) -> FloatArray:
    """Return J (p, 2), or (p, 0) where no process runs."""
    if context.disturbance_period_s is None:
        return np.zeros((len(names), 0))
    return np.array([[float(name in group) for group in CONFOUNDED[context.model]] for name in names])


def weighed(difference: FloatArray, C: FloatArray, V: FloatArray, J: FloatArray) -> Found:
    """Return how far the parameters are from the sheet, and their covariance; see `mixed`."""
    unit = float(np.sqrt(np.trace(C)))
    # Of unit length, in sizes of the sheet's deviation: a direction that the sheet holds exact would swamp the others.
    J = J / float(np.linalg.norm(J, 2)) if J.any() else J
    S = C + V
    best = _evidence(S, difference) + 2.0 * np.log(DECISIVE)
    for scale in SCALES if J.any() else ():
        candidate = C + V + (scale * unit) ** 2 * J @ J.T
        evidence = _evidence(candidate, difference)
        if evidence > best:
            best, S = evidence, candidate
    K = np.linalg.solve(S, C).T
    covariance = C - K @ C
    return Found(K @ difference, 0.5 * (covariance + covariance.T))


def _evidence(S: FloatArray, difference: FloatArray) -> float:
    return -float(np.linalg.slogdet(S)[1]) - float(difference @ np.linalg.solve(S, difference))
