r"""Amplitudes of known columns that wander, beside parameters: how far is likeliest, and the parameters given that.

.. math::
    y_k = z_k^T \beta + h_k^T a_k + e_k, \qquad a_{k+1} = a_k + \eta_k, \quad
    \mathrm{var}\, a_{j,0} = \sigma_j^2, \quad \mathrm{var}\, \eta_j = \frac{w}{n} \sigma_j^2, \quad
    \mathrm{var}\, e_k = s^2 l_k

with w for what all amplitudes share: the variance that each gains over the n rows, of its own. It is that of greatest
restricted likelihood (`_locally_periodic_states`).
"""

import numpy as np

from fdbench.estimator import FloatArray, Regression
from fdbench_baselines._locally_periodic_states import Amplitudes, LikeliestProcess, NoisyRows, filtered, restricted
from fdbench_baselines._mixed_estimation import Found
from fdbench_baselines._state_space_gp import Transition
from fdbench_baselines.least_squares import factorise

WANDERED = (-6.0, 1.0)  # decades of w
CLOSE = 0.1  # of a decade


def wandering(columns: FloatArray, Z: FloatArray, y: FloatArray, loud: FloatArray) -> LikeliestProcess:
    """Return the process of the amplitudes of cosines and sines (n, 2 H), wandering as far as is likeliest.

    An amplitude begins about as large as that of least squares, cosine and sine of a harmonic alike. A row whose
    ``loud`` (n,) is inf is missing.
    """
    from scipy.optimize import minimize_scalar

    n, d = columns.shape
    harmonics = np.repeat(np.arange(1, d // 2 + 1), 2).astype(np.intp)
    H = np.ascontiguousarray(columns)
    design = Amplitudes(H, harmonics, np.zeros(d, dtype=np.bool_), np.ones(d), 1)
    weight = np.where(loud < np.inf, 1.0 / np.sqrt(loud), 0.0)[:, None]
    size = np.sqrt(np.mean((Z * weight) ** 2, axis=0))
    size[size == 0.0] = 1.0
    both = np.hstack((Z / size, columns))
    theta = np.linalg.lstsq(both * weight, y * weight[:, 0], rcond=None)[0]
    left = (y - both @ theta) * weight[:, 0]
    unit = float(np.sqrt(np.mean(left**2))) or 1.0
    amplitudes = theta[Z.shape[1] :].reshape(-1, 2) / unit
    variances = np.repeat(0.5 * np.sum(amplitudes**2, axis=1), 2)[:, None, None]
    rows = NoisyRows(np.column_stack((Z / size, y / unit)), loud, np.zeros(n, dtype=np.bool_))

    def motion(decades: float) -> Transition:
        return Transition(np.ones((d, 1, 1)), variances * (10.0**decades / n), variances)

    def loss(decades: float) -> float:
        value = restricted(rows, design, motion(decades))[0]
        return -value if np.isfinite(value) else 1e300

    decades = WANDERED[0]
    if d > 0:
        decades = float(minimize_scalar(loss, bounds=WANDERED, method="bounded", options={"xatol": CLOSE}).x)
    value, s2 = restricted(rows, design, motion(decades))
    return LikeliestProcess(design, motion(decades), loud, rows.fresh, s2 * unit**2, value)


def innovations_found(process: LikeliestProcess, regression: Regression) -> Found:
    """Return the parameters of least squares of the whitened innovations, and their covariance."""
    columns = np.column_stack((regression.regressors, regression.target))
    run = filtered(NoisyRows(columns, process.loud, process.fresh), process.design, process.motion, keep=False)
    seen = run.variances < np.inf
    white = run.errors[seen] / np.sqrt(run.variances[seen])[:, None]
    u, s, vt, scale = factorise(white[:, :-1], regression.names)
    root = vt.T / s / scale[:, None]
    return Found(root @ (u.T @ white[:, -1]), process.s2 * root @ root.T)
