"""State-space Gaussian process: a locally periodic force beside a drive's linear model, exact and in O(n)."""

from typing import ClassVar, final

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray, Regression
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._disturbance_gain import disturbance_gain
from fdbench_baselines._drive_least_squares import LOOP, process_columns
from fdbench_baselines._friction_columns import curved
from fdbench_baselines._locally_periodic_force import posterior
from fdbench_baselines._locally_periodic_states import designs, likeliest_process
from fdbench_baselines._mixed_estimation import CONFOUNDED
from fdbench_baselines._one_step import MODEL as STATE_SPACE
from fdbench_baselines._one_step import declined, residual_model
from fdbench_baselines._process_force import turns
from fdbench_baselines._slip import below_half
from fdbench_baselines._straight_friction import straight
from fdbench_baselines.idim_iv import IdimIv


@final
class StateSpaceGp(BatchEstimator):
    r"""Linear plant plus a locally periodic Gaussian process, as a state-space model: filter and smoother.

    .. math::
        y_k = z_k^T \beta + f_k + e_k, \quad
        f_k = a_{0,k} + \sum_{j=1}^J \big( a_{j,k} \cos j \varphi_k + b_{j,k} \sin j \varphi_k \big), \quad
        \mathrm{cov}(a_{j,k}, a_{j,l}) = q_j^2 \, k(t_k - t_l), \quad q_j^2 \propto I_j(1 / 4 \sigma_2^2)

    with :math:`k(\tau) = e^{-|\tau| / \ell}` (Ornstein-Uhlenbeck) or Matérn of order 3/2, whichever makes the record
    likelier, and the angle :math:`\varphi` of a spindle or shaker that slips and drifts (`_process_force`). Of a
    velocity loop without Coulomb friction, each amplitude is :math:`a \operatorname{sign} v_r + b v_r`, as that of a
    cut. The Kalman filter gives the restricted likelihood, :math:`\beta` integrated out, and the smoother the force,
    both in O(n) and equal to the dense Gaussian process (`_state_space_gp`). Deviations, :math:`\ell` and
    :math:`\sigma_2` are those of greatest restricted likelihood; where a force starts or stops all begins anew.

    :math:`\beta` is that of ``idim_iv``: instruments that know nothing of the force, and the data sheet. Feedback puts
    the force into Z too, and a force that the process misses would bias what the filter makes of :math:`\beta`. As it
    is found by another row, it is not claimed here. Where the loop's model has a dead band, friction is that of the
    nominal curve, as large as :math:`\beta` has it (`_friction_columns`).

    ``disturbance_N`` is f over the disturbance gain of the mass that :math:`\beta` and sheet make likeliest
    (`_disturbance_gain`); on axes with inverse dynamics without :math:`a_0`, which holds what the friction's model
    misses. Its variance holds that of :math:`\beta` and of the gain. White force that no harmonic holds is told from
    noise by the quietest 0.3 s (`_locally_periodic_force`). ``output`` is :math:`z^T \beta + f`. A model in state
    space has no :math:`\beta`; y is there what its equation leaves of a reading.

    Parameters
    ----------
    harmonics : int
        J, at least 0; of rows that are filtered, those below half of the sampling frequency.

    Raises
    ------
    SpecError
        If ``harmonics`` is out of bounds, or the record does not identify every parameter.

    Validity
    --------
    One noise for the whole record. Where rows are filtered, neighbours have noise in common, and the stated variance of
    the force is too small.

    References
    ----------
    Solin and Särkkä, Explicit link between periodic covariance functions and state space models, AISTATS 2014, pages
    904-912; Särkkä and Solin, Applied Stochastic Differential Equations, 2019, section 12.3; Patterson and
    Thompson, Biometrika 58 (1971), 545-554 (restricted likelihood). Starts, gain and irregular force are ours.

    Examples
    --------
    Quarters of a period of a shaker, a sine of 5 N in 32 samples.

    >>> from fdbench_baselines._example import example_drive
    >>> found = StateSpaceGp(harmonics=1).fit(*example_drive(wave_N=5.0, period_s=0.32))
    >>> [abs(force) for force in found.disturbance_N[192:224:8].round(1).tolist()]
    [0.0, 5.0, 0.0, 5.0]
    """

    made_for: ClassVar[tuple[str, ...] | None] = (STATE_SPACE, *CONFOUNDED)

    def __init__(self, harmonics: int = 8) -> None:
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"state_space_gp: harmonics = {harmonics!r} must be an integer of at least 0.")
        self.harmonics = harmonics

    def skip(self, context: Context) -> str | None:
        """Skip where the model is neither an equation of a drive's force nor one in state space."""
        if context.nominal and not (context.model in CONFOUNDED and isinstance(context.plant, FeedDrive)):
            return "the model is no equation of a feed drive in parameters"
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find beta by instruments, hyperparameters by likelihood, the force by a smoother."""
        regression, predicted = residual_model(context, context.regression(record))
        Z, y, step_s = regression.regressors, regression.target, regression.sampling_time_s
        n, p = Z.shape
        beta, covariance, trusted = np.zeros(p), np.zeros((p, p)), np.ones(n, dtype=np.bool_)
        if p:
            start = IdimIv().fit(context, record)
            beta = np.array([start.parameters[name] for name in regression.names])
            covariance = np.zeros((p, p)) if start.covariance is None else start.covariance
            trusted = trusted if context.model == LOOP else straight(context, Z)
        Z = curved(context, Z)
        left = y - Z @ beta
        feed = Z[:, 0] if process_columns(regression).shape[1] else None
        angle, harmonics = self._angle(context, regression, np.where(trusted, left, 0.0))
        is_loop, is_sudden = context.model == LOOP, feed is None and context.model in (LOOP, STATE_SPACE)
        candidates = designs(angle, harmonics, feed, is_loop or context.model == STATE_SPACE)
        process = likeliest_process(left, Z, step_s, candidates, trusted, is_sudden)
        found = posterior(process, left, Z, covariance, step_s, is_loop)
        gain, deviation = disturbance_gain(context, regression, beta)
        force = found.force / gain
        smoothed = y - found.left if predicted is None else y - found.left + predicted
        return Estimate(
            disturbance_N=force,
            disturbance_variance_N2=found.variance / gain**2 + (deviation * force) ** 2,
            output=smoothed,
            output_variance=found.variance + process.s2,
        )

    def _angle(self, context: Context, regression: Regression, left: FloatArray) -> tuple[FloatArray, int]:
        """Return the angle (n,) and how many harmonics it has."""
        time_s, period_s, harmonics = regression.time_s, context.disturbance_period_s, self.harmonics
        if period_s is None or harmonics == 0:
            return np.zeros(len(time_s)), 0
        if context.model != LOOP:  # whose rows are not filtered, and hold the faster harmonics as well
            harmonics = below_half(time_s, period_s, harmonics)
        return (turns(time_s, left, period_s) if harmonics else np.zeros(len(time_s))), harmonics
