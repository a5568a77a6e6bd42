"""Sparse linear regression with a basis of nonlinear functions."""

import math
from collections.abc import Sequence
from typing import ClassVar, final

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record
from fdbench_baselines._drive_features import VELOCITY_COLUMNS
from fdbench_baselines._drive_run import Learned, free_run
from fdbench_baselines._function_basis import NONLINEAR, FloatArray, estimate_force
from fdbench_baselines._function_basis import declined as no_spectra
from fdbench_baselines._one_step import MODEL as STATE_SPACE
from fdbench_baselines._one_step import declined as no_equation
from fdbench_baselines._one_step import residual_model
from fdbench_baselines._sparse_drive import Sparseness, learn_drive, learn_steps
from fdbench_baselines._sparse_regression import threshold_sequentially

SPECTRA = "inverse_frequency_response"


@final
class SlrNfb(BatchEstimator):
    r"""Sequentially thresholded least squares on nonlinear functions: LR-NFB with small coefficients removed, SLR-NFB.

    .. math:: \hat\zeta_S = \arg\min_{\zeta_S} |Y_i - G_S(X) \, \zeta_S|^2, \quad
              S \leftarrow \{ j \in S : |\hat\zeta_j| \ge \gamma \}

    for each part i of a line by itself, N times; the test is made at the start of a pass. On spectra G, X, Y and the
    result are those of ``lr_nfb``, which is the case :math:`\gamma = 0`.

    On a drive Y is the target of its linear model, whose regressors always stay, and G holds curves of friction, of
    position and of the screw's lead, and harmonics of the nominal period, slip found, with amplitudes that may change
    (`_drive_features`); see `_sparse_drive` for the scaling of the test and for what ``parameters`` mean.
    ``disturbance_N`` is the periodic part or, where no period is known, what remains; the free run has all but the
    periodic part. On a drive known in state space G holds steps of the force (`learn_steps`).

    Parameters
    ----------
    threshold : float
        gamma on spectra, on the coefficients as they are: N for a constant, N per unit of the function else.
    iterations : int
        N, at least 0.
    functions : sequence of str
        As for ``lr_nfb``.
    share : float
        gamma on a drive: smallest root mean square of a term over that of what the regressors leave; at least 0.
    harmonics : int
        Harmonics of the period, at least 0.
    envelope_s : float
        Time between two amplitudes of a harmonic, s; above 0.

    Raises
    ------
    SpecError
        If a parameter is out of bounds, or as for ``lr_nfb``.

    References
    ----------
    Qu and Vogl (2021), Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 2.3, which does not state gamma; Brunton, Proctor, Kutz (2016),
    PNAS 113. The functions for drives are ours.

    Examples
    --------
    Forces of twice the square of the acceleration: all other functions of it are removed, and the sine is 0 exactly.

    >>> from fdbench_baselines._example import example_spectra
    >>> found = SlrNfb().fit(*example_spectra(power=2)).disturbance_N
    >>> found[::4].round(6).tolist(), float(found[2])
    ([18.0, -18.0], 0.0)
    """

    made_for: ClassVar[tuple[str, ...] | None] = (SPECTRA, STATE_SPACE, *VELOCITY_COLUMNS)

    def __init__(
        self,
        threshold: float = 0.2,
        iterations: int = 10,
        functions: Sequence[str] = NONLINEAR,
        share: float = 0.05,
        harmonics: int = 4,
        envelope_s: float = 1.0,
    ) -> None:
        for name, value in (("threshold", threshold), ("share", share)):
            if not (math.isfinite(value) and value >= 0.0):
                raise SpecError(f"{name}: {value:g} is outside [0, inf).")
        for name, value in (("iterations", iterations), ("harmonics", harmonics)):
            if value < 0:
                raise SpecError(f"{name}: {value} is negative.")
        if not (math.isfinite(envelope_s) and envelope_s > 0.0):
            raise SpecError(f"envelope_s: {envelope_s:g} is outside (0, inf).")
        self.threshold, self.iterations, self.functions = threshold, iterations, tuple(functions)
        self.how = Sparseness(share, iterations, harmonics, envelope_s)
        self._learned: Learned | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where there are neither spectra nor an equation of a force on a drive."""
        if context.model in VELOCITY_COLUMNS:
            return None
        return no_equation(context) if context.model == STATE_SPACE else no_spectra(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Factorise once and remove columns, on spectra line by line."""
        if context.model in VELOCITY_COLUMNS:
            estimate, self._learned = learn_drive(context, record, self.how)
            return estimate
        self._learned = None
        regression, predicted = residual_model(context, context.regression(record))
        if predicted is not None:
            return learn_steps(regression, predicted, self.how)
        return estimate_force(context, record, self.functions, self._solve)

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the drive's response with its curves of friction and position, undisturbed."""
        return None if self._learned is None else free_run(context, self._learned, command)

    def _solve(self, regressors: FloatArray, targets: FloatArray) -> FloatArray:
        return threshold_sequentially(regressors, targets, self.threshold, self.iterations).coefficients
