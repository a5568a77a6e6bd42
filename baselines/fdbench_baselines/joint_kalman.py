"""Joint online identification: drive parameters and a drifting periodic force in a bank of extended Kalman filters."""

import itertools
from array import array
from typing import ClassVar, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._data_sheet import sheet_beforehand
from fdbench_baselines._disturbance_gain import mass_share
from fdbench_baselines._joint_kalman_bank import BEFORE_WAVES, Bank, RowPassing, run_bank
from fdbench_baselines._mixed_estimation import applies
from fdbench_baselines._one_step import OneStep, declined
from fdbench_baselines._slip import LARGEST_SLIP
from fdbench_baselines._straight_friction import DIRECTIONS, VELOCITIES, straight

LOOP = "velocity_loop"
FORCE_SHARE = 0.01  # of the force limit: how large each part of a force may be beforehand
SLOW = 0.05  # of the velocity limit: feed at which the parts that grow with it may be as large
READING = 0.1  # of such a force: deviation of a reading beforehand
SLIP, SLIP_PER_ROOT_S = 5e-3, 3e-4
GROWTH_PER_S, GROWTH_S = 0.5, 2.0
MEMORY_S = 30.0
WAVES, WALK, WALKS_ALONE = (1e-6, 1e-4), 1e-5, (1e-4, 1e-2)
ODDS = 10.0  # against a filter with more freedom, before a row
EVIDENCE_ROWS = 1000.0
SURPRISE, PAUSE_ROWS = 6.0, 60


@final
class JointKalman(OnlineEstimator):
    r"""Parameters, force, frequency and growth of a periodic force at once, row by row, from the data sheet alone.

    .. math::
        y_k = z_k^T (\beta_0 + L b) + g F_k + e_k, \qquad
        F = w + \sum_{h=1}^H c_h + m_0 \operatorname{sign}(v) + v \Big( m_1 + \sum_{h=1}^H c'_h \Big)

    with b standard normal for the sheet's covariance :math:`L L^T`, a walk w, and waves at the harmonics of the nominal
    period, whose frequency slips and whose size grows, both of which are states too; see `_joint_kalman_bank`. Eight
    filters run side by side: waves that change slowly or fast, a shaker or a cutter, whose force has a mean and grows
    with the feed v, and parameters that hold or walk. What they say is weighed by their likelihood over the last
    thousand rows. A filter that is lost begins again where the best of its kind is, so that a changed inertia is found
    by a filter that walks and then held by one that does not. The variance of the readings is learnt in each filter.

    A row that stands out by six deviations (velocity loop) lets the force begin anew, as where a tool enters; one of
    four counts less. Rows off the straight line of the sheet's friction are predicted, not learnt from. Of inverse
    dynamics the rows are filtered forwards and backwards: there is neither surprise, cutter nor walking parameter,
    and online means row by row only. A model in state space has no b, and F is the walk.

    ``parameters`` are those after the last row, with covariance; ``disturbance_N`` is the force after each row, without
    those to come, in the mass that sheet and parameters so far make likeliest (`_disturbance_gain`), with variance;
    a walk beside the waves of a shaker is a friction and no part of it. ``output`` is the row before it came.

    Told: the sheet with its covariance, the period (within 0.5 %, drifting by 0.03 % in a second), the limits of force
    and velocity as scales. A row costs O(M m^2): 20 us for M = 8 filters of m <= 33 states; 70 kB, plus 32 bytes a
    row for the answer.

    Parameters
    ----------
    harmonics : int
        H, at least 0; none where no period is known, in inverse dynamics those below half of the sampling frequency.
    parameter_walk_per_root_s : float
        Deviation by which walking parameters move in a second, in those of the data sheet; at least 0, 0 for no walk.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or a filter diverges.
    PluginError
        If a sample comes before ``start``.

    Validity
    --------
    A frequency that drifts faster than told is followed late: at 55 Hz and 0.1 Hz/s the force errs by 13 %; one that
    jumps by more than its slip is lost until the force begins anew. A constant force is no other than
    an unequal Coulomb friction until the drive reverses, and a mean cutting force that grows with the feed is told from
    viscous friction by the sheet alone. Noise of the velocity reading biases, as it does least squares. Where the
    noise of the rows is not white, as in inverse dynamics, the covariance is too small.

    References
    ----------
    La Scala, Bitmead and Quinn, IEEE Trans. Signal Processing 44 (1996), 431-434, for slip as a state; Magill, IEEE
    Trans. Automatic Control 10 (1965), 434-439, for the bank; McPherson, thesis, 2024, leaves it open. Growth, cutter
    and what follows a lost filter are ours.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = JointKalman().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive",)

    def __init__(self, harmonics: int = 6, parameter_walk_per_root_s: float = 1.0) -> None:
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"joint_kalman: harmonics = {harmonics!r} must be an integer of at least 0.")
        walk = parameter_walk_per_root_s
        if not 0.0 <= walk < np.inf:
            raise SpecError(f"joint_kalman: parameter_walk_per_root_s = {walk!r} must be at least 0 and finite.")
        self.harmonics, self.parameter_walk_per_root_s = harmonics, parameter_walk_per_root_s
        self._bank: Bank | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a force on a feed drive whose limits are known."""
        if not isinstance(context.plant, FeedDrive):
            return "the plant is no feed drive"
        if not np.isfinite(context.plant.controller.force_limit_N):
            return "the drive's force limit, from which the size of forces is told, is not known"
        return declined(context)

    def start(self, context: Context) -> None:
        """Forget everything; the parameters are the data sheet's."""
        plant, reason = context.plant, self.skip(context)
        if reason is not None or not isinstance(plant, FeedDrive):
            raise SpecError(f"joint_kalman: {reason}.")
        self._context, self._sheet, self._mass = context, sheet_beforehand(context), mass_share(context)
        p, is_filtered, step_s = len(context.nominal), context.model in DIRECTIONS, context.sampling_time_s
        if is_filtered and plant.inverse_dynamics is not None:
            step_s *= plant.inverse_dynamics.decimation
        self._waves, angle = 0, 0.0
        if context.disturbance_period_s is not None and p > 0:
            angle = 2.0 * np.pi * step_s / context.disturbance_period_s
            most = int(np.pi / angle * (1.0 - LARGEST_SLIP)) if is_filtered else self.harmonics
            self._waves = min(self.harmonics, most)
        self._motion = RowPassing(
            step_s=step_s,
            angle=angle,
            memory=float(np.exp(-step_s / MEMORY_S)),
            slip=SLIP_PER_ROOT_S**2 * step_s,
            growth=-(GROWTH_PER_S**2) * float(np.expm1(-2.0 * step_s / GROWTH_S)),
            parameter=self.parameter_walk_per_root_s**2 * step_s,
            growth_kept=float(np.exp(-step_s / GROWTH_S)),
            evidence_kept=1.0 - 1.0 / EVIDENCE_ROWS,
            surprise=np.inf if is_filtered else SURPRISE,
            pause=PAUSE_ROWS,
        )
        self._bank = beginning(p, self._waves, context.model == LOOP)
        self._force_N = FORCE_SHARE * plant.controller.force_limit_N
        self._slow_m_per_s = SLOW * plant.velocity_limit_m_per_s
        self._step = OneStep(plant, context.sampling_time_s) if p == 0 else None
        self._before: FloatArray | None = None
        self._rows = array("d")
        self._b = np.zeros(p)

    def update(self, sample: Sample) -> None:
        """Take in a row."""
        regressors, target, readings = sample.regressors[np.newaxis], np.array([sample.target]), sample.readings
        self._take(regressors, target, sample.disturbance_gain, readings[np.newaxis])

    def estimate(self) -> Estimate:
        """Return what was said of the rows so far, and the parameters by now with their covariance."""
        bank = self._started()
        force, force_variance, output, output_variance = np.array(self._rows).reshape(-1, 4).T
        p, root = len(self._b), self._sheet.root
        weights = np.exp(bank.weight - bank.weight.max())
        weights /= weights.sum()
        apart = bank.x[:, :p] - self._b
        covariance = np.einsum("f,fij->ij", weights, bank.P[:, :p, :p] + apart[:, :, None] * apart[:, None, :])
        covariance = root @ covariance @ root.T
        beta = self._sheet.nominal + root @ self._b
        return Estimate(
            parameters=dict(zip(self._context.nominal, beta.tolist(), strict=True)),
            covariance=0.5 * (covariance + covariance.T) if p > 0 else None,
            disturbance_N=force,
            disturbance_variance_N2=force_variance + (self._mass.deviation * force) ** 2,
            output=output,
            output_variance=output_variance,
        )

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        self.start(context)
        regression = context.regression(record)
        readings = np.empty((len(regression.target), 0)) if regression.readings is None else regression.readings
        self._take(regression.regressors, regression.target, regression.disturbance_gain, readings)
        return self.estimate()

    def _take(self, regressors: FloatArray, target: FloatArray, gain: float, readings: FloatArray) -> None:
        bank, context, p = self._started(), self._context, len(self._b)
        known, feed, learnt = regressors @ self._sheet.nominal, np.zeros(len(target)), np.ones(len(target), np.bool_)
        if self._step is not None:
            known = self._step.predicted(self._before, readings)
            self._before = readings[-1]
        else:
            columns = (0,) if context.model == LOOP else VELOCITIES[context.model]
            feed = regressors[:, columns].sum(axis=1) / self._slow_m_per_s
            learnt = straight(context, regressors) if applies(context) else learnt
        unit = abs(gain) * self._force_N
        Z = np.ascontiguousarray(regressors @ self._sheet.root / unit)
        rows, b = run_bank(bank, Z, (target - known) / unit, feed, learnt, self._waves, self._motion)
        if not (np.isfinite(rows).all() and np.isfinite(bank.P).all()):
            raise SpecError("joint_kalman: a filter has diverged. Is the period that of the force on the drive?")
        self._b = b[-1]
        heavier = np.exp((b @ self._sheet.root.T) @ self._mass.weights) if p > 0 else np.ones(len(target))
        scale = unit / gain * heavier
        force = np.where(learnt, rows[:, 0], 0.0) if context.model in DIRECTIONS else rows[:, 0]
        said = (force * scale, rows[:, 1] * scale**2, known + unit * rows[:, 2], unit**2 * rows[:, 3])
        self._rows.frombytes(np.column_stack(said).tobytes())

    def _started(self) -> Bank:
        if self._bank is None:
            raise PluginError("joint_kalman: start(context) must come before update and estimate.")
        return self._bank


def beginning(p: int, waves: int, is_loop: bool) -> Bank:
    """Return the filters before the first row, for p parameters and so many harmonics.

    >>> beginning(p=4, waves=6, is_loop=True).x.shape, beginning(p=0, waves=0, is_loop=False).x.shape
    ((8, 33), (2, 3))
    """
    slow_or_fast = WAVES if waves > 0 else (0.0,)
    walks = (WALK,) if waves > 0 else WALKS_ALONE
    cutters = (False, True) if waves > 0 and is_loop else (False,)
    kinds = list(itertools.product(slow_or_fast, walks, cutters, (False, True) if is_loop else (False,)))
    M, m = len(kinds), p + BEFORE_WAVES + 2 * waves + (2 + 2 * waves if any(cutters) else 0)
    variances = np.ones(m)
    variances[p + 1], variances[p + 2] = SLIP**2, GROWTH_PER_S**2
    wave, walk, cutter, walking = (np.array(column) for column in zip(*kinds, strict=True))
    prior = -np.log(ODDS) * (cutter.astype(np.float64) + walking)
    return Bank(
        wave=wave,
        walk=walk,
        cutter=cutter,
        walking=walking,
        prior=prior,
        weight=prior.copy(),
        reading=np.full(M, READING**2),
        rows=np.zeros(M, dtype=np.int64),
        waiting=np.zeros(M, dtype=np.int64),
        x=np.zeros((M, m)),
        P=np.tile(np.diag(variances), (M, 1, 1)),
    )
