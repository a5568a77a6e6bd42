"""Hybrid model by region: physics, and a correction by recursive least squares that differs with motion and place."""

from typing import Any, ClassVar, final

import numpy as np

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants import RespondingPlant
from fdbench.record import Record
from fdbench_baselines._hybrid_drive import DriveHybrid
from fdbench_baselines._one_step import MODEL as STATE_SPACE
from fdbench_baselines._one_step import declined
from fdbench_baselines._regional_correction import follow, interval, learn, means, quadrant, staked

MM_PER_M = 1e3
DRIVES = ("velocity_loop", "inverse_dynamics", "directional_inverse_dynamics")
# How much narrower than a common weight a region's difference is beforehand; 0 is none, as without regions.
NARROWER = np.array([1e-2, 1e-4, 0.0])
TENTHS = 10


@final
class HybridRegions(OnlineEstimator):
    r"""Nominal physics and a learnt correction with weights by region, which risks no more than it has gained.

    On a stage the force H that the physics lacks enters by the same modes wherever it acts. Straight in each region r
    of motion and place, :math:`H = h_r + k_r x + d_r \dot x`, it leaves an error with poles in common and a numerator
    for each region:

    .. math::
        \hat e_k = (w + \delta_r)^T \varphi_k + a^T (e_{k-1} \ldots e_{k-p}), \qquad
        \varphi_k = (1, x_{pb,k} \ldots x_{pb,k-q}), \qquad e = x - x_{pb}

    r is one of four: :math:`x_{pb}` rises or not, above zero or not, where friction, drag, and cables change sign. All
    weights are those of recursive least squares from :math:`w, a \sim N(0, \sigma^2 / \lambda)` and
    :math:`\delta_r \sim N(0, \nu \sigma^2 / \lambda)`, so that a region that was never visited has the common ones.
    Of three :math:`\nu`, 0 among them, a batch takes the one whose batches before were foretold best (empirical Bayes,
    by prediction). Within a batch errors are predicted ones, none beyond the largest that was measured before it.

    What is added to physics is :math:`s_k \hat e_k`. With all sums over the batches before,

    .. math::
        s_k = \min\left(1, \frac{\sum e \hat e}{\sum \hat e^2}, \frac{(G - Q_k)^+}{\hat e_k^2}\right), \qquad
        G = \sum e^2 - (e - \hat e)^2, \qquad Q_k = \sum_{i < k} s_i \hat e_i^2 \text{ of this batch}

    so that a batch without any error would lose no more than was gained. The interval is that of a prediction h samples
    ahead, with :math:`\sigma^2` of one sample, P of the weights by recursive least squares, :math:`\psi` the impulse
    response of a, and c the mean of past squares beside it, half of them forgotten in 1400 samples, a region's drawn to
    that of all:

    .. math:: v_k = c_r \min(\sigma^2 (\psi_0^2 + \ldots + \psi_{h-1}^2 + \varphi^T P \varphi), \max e^2)

    In a free run both halves of the record choose :math:`\nu` and a `share` of the correction, each with the weights of
    the other. On a drive it is the linear model of `DriveHybrid` with a mean of its own on each side of zero of the
    foretold target; ``output`` is as safe, and a free run takes the `share` of the corrections that the record's own
    command asks for. The parameters and the force behind it are `hybrid_rls`'s, whose row claims them.

    Parameters
    ----------
    response_lags, error_lags : int
        q and p, at least 0.
    batch_samples : int
        Samples that are predicted at once; at least 1.
    regularisation_m2 : float
        :math:`\lambda`, above 0; the 1 in the features stands for 1 mm.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the model is none of these.
    PluginError
        If a sample comes before ``start``.

    Validity
    --------
    It was told the nominal plant alone. An error of the other sign than foretold, and no larger, costs up to three
    times the stake: what is safe is what goes on as before. A first move after rest is left to physics until a batch of
    it has been seen, and while errors still grow the stake withholds a part of a correction that would be right.

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eqs. (3) to (6). Regions, stake and interval are ours; the share is drawn to 0 as
    by James, Stein, Estimation with quadratic loss (1961).

    Examples
    --------
    The mass is 1.25 times that of the data sheet, whose free run would begin with 0.05, 0.075, 0.0875 m/s.

    >>> from fdbench_baselines._example import example_drive
    >>> (context, record), hybrid = example_drive(mass_ratio=1.25), HybridRegions()
    >>> hybrid.predict(context, hybrid.fit(context, record), record)[:3].round(4).tolist()
    [0.04, 0.064, 0.0784]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", STATE_SPACE, *DRIVES)

    def __init__(
        self,
        response_lags: int = 10,
        error_lags: int = 50,
        batch_samples: int = 100,
        regularisation_m2: float = 1e-6,
    ) -> None:
        bounds = {
            "response_lags": (response_lags, 0),
            "error_lags": (error_lags, 0),
            "batch_samples": (batch_samples, 1),
        }
        for name, (value, least) in bounds.items():
            if not isinstance(value, int) or value < least:
                raise SpecError(f"hybrid_regions: {name} = {value!r} must be an integer of at least {least}.")
        if not 0.0 < regularisation_m2 < np.inf:
            raise SpecError(f"hybrid_regions: regularisation_m2 = {regularisation_m2!r} must be above 0 and finite.")
        self.response_lags, self.error_lags, self.batch_samples = response_lags, error_lags, batch_samples
        self.regularisation_m2 = regularisation_m2
        self._context: Context | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where the model is neither a servo's response nor an equation of a force on a drive."""
        if isinstance(context.plant, RespondingPlant) or context.model in DRIVES:
            return None
        if context.model == STATE_SPACE:
            return declined(context)
        return "the model is neither the response of a servo nor an equation of a force on a drive"

    def start(self, context: Context) -> None:
        """Forget everything."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"hybrid_regions: {reason}.")
        self._context = context
        self._record: Record | None = None
        self._nominal = np.array(list(context.nominal.values()))
        on_stage = isinstance(context.plant, RespondingPlant)
        self._drive = None if on_stage else DriveHybrid(context, self.error_lags)
        self._rows: list[tuple[float, float, float]] = []

    def update(self, sample: Sample) -> None:
        """Take a sample in."""
        self._started()
        physics = float((sample.regressors * self._nominal).sum())
        self._rows.append((sample.time_s, physics, sample.target))
        self._gain = sample.disturbance_gain
        if self._drive is not None:
            self._drive.take(
                sample.regressors[np.newaxis],
                np.array([sample.target]),
                sample.disturbance_gain,
                sample.readings[np.newaxis],
            )

    def estimate(self) -> Estimate:
        """Return the predictions made so far, each from the batches before it, and what is known of a drive by now."""
        self._started()
        if self._drive is not None:
            return self._on_drive(self._drive)
        found = [self._on_axis(response, error) for response, error in self._axes()]
        output, variance = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return Estimate(output=output / MM_PER_M, output_variance=variance / MM_PER_M**2)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        found = super().fit(context, record)
        self._record = record
        return found

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return physics and the share of the correction that the record's own free runs ask for."""
        self._started()
        if not isinstance(context.plant, RespondingPlant):
            return self._free_drive(context, command)
        axes = self._axes()
        responses = np.split(MM_PER_M * context.plant.nominal_response(command), len(axes))
        runs = [row + self._free_axis(*axis, row) for axis, row in zip(axes, responses, strict=True)]
        return np.concatenate(runs) / MM_PER_M

    def _started(self) -> None:
        if self._context is None:
            raise PluginError("hybrid_regions: start(context) must come before update and estimate.")

    def _axes(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return response and error of each axis in mm; a row of an earlier time begins another one."""
        time_s, response, target = np.array(self._rows).reshape(-1, 3).T
        breaks = np.flatnonzero(np.diff(time_s) < 0.0) + 1
        errors = np.split(MM_PER_M * (target - response), breaks)
        return list(zip(np.split(MM_PER_M * response, breaks), errors, strict=True))

    def _learn(self, axis: tuple[FloatArray, FloatArray], begin: int, end: int) -> Any:
        lags, ridge = (self.response_lags, self.error_lags), MM_PER_M**2 * self.regularisation_m2
        return learn(*axis, begin, end, *lags, self.batch_samples, ridge, NARROWER)

    def _on_axis(self, response: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return predictions and their variances, in mm."""
        foretold, spread, _ = self._learn((response, error), 0, len(error))
        added = staked(foretold, error, self.batch_samples)
        regions = np.array([quadrant(response, k) for k in range(len(response))])
        return response + added, interval(error - added, spread, regions, self.batch_samples)

    def _free_axis(self, response: FloatArray, error: FloatArray, ahead: FloatArray) -> FloatArray:
        """Return the error of a free run; both halves choose how narrow regions are, and the share."""
        n, q, limit = len(error), self.response_lags, float(np.abs(error).max())
        ends = (0, n // 2), (n // 2, n)
        first, second = (self._learn((response, error), *part)[2] for part in ends)
        runs = []
        for early, late in zip(second, first, strict=True):
            withheld = (follow(early, response, q, limit)[: n // 2], follow(late, response, q, limit)[n // 2 :])
            runs.append(np.concatenate(withheld))
        best = int(np.argmin([np.sum((run - error) ** 2) for run in runs]))
        weights = self._learn((response, error), 0, n)[2][best]
        return share(runs[best], error) * np.asarray(follow(weights, ahead, q, 2.0 * limit))

    def _on_drive(self, drive: DriveHybrid) -> Estimate:
        """Return what the linear model foretold, drawn to each side's mean and staked as on a stage."""
        found = drive.estimate()
        output, variance = np.asarray(found.output), found.output_variance
        _, physics, target = np.array(self._rows).reshape(-1, 3).T
        if not len(self._nominal):
            physics = output - np.asarray(found.disturbance_N) * self._gain
        error, regions = target - physics, (physics < 0.0).astype(np.int64)
        foretold = output - physics + means(target - output, regions, self.batch_samples)
        added = staked(foretold, error, 1)
        if variance is not None:
            variance = interval(error - added, variance, regions, 1)
        return Estimate(output=physics + added, output_variance=variance)

    def _free_drive(self, context: Context, command: Record) -> FloatArray | None:
        """Return the sheet's free run, and the share of what the found parameters change that the record asks for."""
        model, sheet = context.linear_model, context.nominal
        run = model.free_run(command, sheet) if sheet else None
        if run is None or self._drive is None or self._record is None:
            return run
        found = self._drive.estimate().parameters
        known, own = model.free_run(self._record, sheet), model.free_run(self._record, found)
        changed = model.free_run(command, found)
        if known is None or own is None or changed is None:
            return run
        part = share(own - known, np.array(self._rows)[:, 2] - known)
        return np.asarray(run + part * (changed - run))


def share(run: FloatArray, error: FloatArray) -> float:
    r"""Return how much of a run (n,) an error (n,) asks for beyond doubt, from 0 to 1.

    .. math:: \min(1, (\hat s - v / \hat s)^+), \qquad \hat s = \frac{\sum r e}{\sum r^2}, \qquad
        v = \sum_b \left(\frac{\sum_{k \in b} r (e - \hat s r)}{\sum r^2}\right)^2

    with v the variance of :math:`\hat s` over tenths b of the record (James, Stein 1961, positive part).
    """
    power = float(run @ run)
    asked = float(run @ error) / power if power > 0.0 else 0.0
    if asked <= 0.0:
        return 0.0
    tenths = np.array_split(run * (error - asked * run), TENTHS)
    variance = sum(float(part.sum() / power) ** 2 for part in tenths)
    return min(max(asked - variance / asked, 0.0), 1.0)
