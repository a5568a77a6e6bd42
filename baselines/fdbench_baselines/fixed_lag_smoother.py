"""Input estimation with a fixed delay: the force given the readings of the next few samples, friction a state too."""

from typing import ClassVar, final

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.record import Record
from fdbench_baselines._fixed_lag import lagged_state, lagged_sum
from fdbench_baselines._force_densities import ForceStart, likeliest
from fdbench_baselines._force_densities import declined as no_state_space
from fdbench_baselines._found_drive import simulated_target
from fdbench_baselines._friction_motion import declined, driven, parameters_with_covariance, sheet
from fdbench_baselines._motion_smoother import MOTION
from fdbench_baselines._steady_smoother import filtered
from fdbench_baselines._walked_motion import found_shapes, under_waves, walked

FORCE = -1
BEGIN = ForceStart(q_N2_per_s=1e5, process_factor=20.0, initial_force_N=100.0)  # those of rts_smoother
SHAPE_DEVIATION = 0.2  # that of rts_friction
FIRST = 60  # evaluations of the likelihood


@final
class FixedLagSmoother(BatchEstimator):
    r"""Force given all readings up to L samples after a row's own, and none beyond.

    .. math::
        \hat F_{k|k+L} = \hat F_k + \sum_{j=0}^{L} p_j^T C^T S_{k+j}^{-1} e_{k+j}, \qquad
        p_0 = P_k s, \quad p_{j+1} = A_{k+j} (I - K_{k+j} C) p_j

    with the estimate and P before reading k, and innovations e of covariance S (`_fixed_lag`). Row k lies between
    samples k and k + 1, and the latter is its own reading.

    In state space the model is that of ``rts_smoother``, the force a random walk: at the steady gain L + 1 weights of
    the innovations are all there is. ``disturbance_N`` of a row is the mean of the force at its two ends, both given
    the readings up to L samples after the row, with the variance of the later one.

    On a drive whose force is logged it is that of ``rts_friction``: motion, mass, viscous and Coulomb friction, offset
    and shape of the friction as states, with bristles carried along the motion as read; a walk; and waves. Waves are
    harmonics of the nominal period as it stands, a slip being left to their amplitudes, as what tells the phase in
    ``rts_friction`` is the whole record. For the same reason slopes of the friction are those about the sheet, and no
    wave begins anew. ``disturbance_N`` is the waves and a cut's mean; without nominal friction or a period the walk is
    a part of it. Its factor of mass is that given the same readings. ``parameters`` are those after the last sample.

    What the whole record tells are variances alone: those of noises, waves and their memory are of greatest likelihood,
    as in ``rts_smoother`` and ``rts_friction``, and of waves whether they grow with the feed. Fixed beforehand, it runs
    online and answers L samples late.

    Told: in state space the model with its noises; on a drive the sheet with its covariance, the period (amplitudes
    have to follow its slip), the force limit as a scale. Beside the filter, a sample costs L + 1 multiplications a
    reading at the steady gain, :math:`8 (L + 1) m` of m states on a drive, and the memory online is that of L + 1
    samples; as it stands it keeps :math:`8 m^2` bytes a sample.

    Parameters
    ----------
    lag : int
        L, samples, at least 0, which is the filter. By default as many as leave the variance that the models state for
        a shaker, a cut and the force at a spindle within five per cent of that given all readings. At a spindle, where
        a reading tells of the force directly, 3 leave it within one per cent.
    harmonics : int
        Of the period, at least 0; in positions those below half of the sampling frequency.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the scenario is neither in state space nor of a drive whose force is logged,
        the regression has no readings, or there is no steady gain.

    Validity
    --------
    A lag is enough where it spans the filter's memory of the force. Where noise of positions hides the force over more
    samples, or waves are told from each other over several periods, it is hardly more than the filter. Waves that slip
    faster than their memory forgets are late, and behind ``rts_friction``, which finds their phase. A force that
    repeats with the position, as unknown cogging, goes to the parameters and makes the claim worse than none. A mode
    with another gain than the sheet's, the mean of a cut beside friction, and friction of another shape fail as in
    ``rts_smoother`` and ``rts_friction``. Samples that are held are filled by a spline through those about them, which
    may lie beyond the lag.

    References
    ----------
    Moore, Discrete-time fixed-lag smoothing algorithms, Automatica 9 (1973), 163-173; Anderson and Moore, Optimal
    Filtering, 1979, chapter 7; Lourens et al., Mechanical Systems and Signal Processing 27 (2012), 446-460 (the force
    as a state).

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_drive, example_network
    >>> found = FixedLagSmoother().fit(*example_network(force_N=10.0))
    >>> found.disturbance_N[[500, 1000, -1]].round(2).tolist()
    [10.0, 10.0, 10.0]

    A drive whose mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> found = FixedLagSmoother().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    >>> found.disturbance_N[[100, 101, -1]].round(2).tolist()  # 5 sin(2 pi t / 65 ms)
    [3.32, -1.2, 4.96]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive", "sensor_network", "spindle")

    def __init__(self, lag: int = 20, harmonics: int = 4) -> None:
        for name, value in (("lag", lag), ("harmonics", harmonics)):
            if not isinstance(value, int) or value < 0:
                raise SpecError(f"fixed_lag_smoother: {name} = {value!r} must be an integer of at least 0.")
        self.lag, self.harmonics = lag, harmonics
        self._shapes: dict[str, float] = {}

    def skip(self, context: Context) -> str | None:
        """Skip where the model is neither one in state space nor an equation of a force on a feed drive."""
        reason = declined(context)
        return reason if no_state_space(context) is not None else None

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find variances by likelihood, filter, and look as far ahead as the lag."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"fixed_lag_smoother: {reason}.")
        if no_state_space(context) is not None:
            return self._of_drive(context, record)
        found = likeliest("fixed_lag_smoother", context, record, BEGIN)
        force, variance = lagged_state(*found, FORCE, self.lag)
        before, _ = lagged_state(*found, FORCE, self.lag + 1)
        force[1:] = 0.5 * (force[1:] + before[:-1])
        return Estimate(disturbance_N=force, disturbance_variance_N2=filtered(*found).scale * variance)

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the target of an axis as it was found, simulated; in a velocity loop that of the parameters."""
        found = simulated_target(context, estimate, self._shapes, command)
        return super().predict(context, estimate, command) if found is None else found

    def _of_drive(self, context: Context, record: Record) -> Estimate:
        drive, paper, rows = driven(context, record), sheet(context), context.regression(record).rows
        search = walked(context, drive, paper, SHAPE_DEVIATION).likeliest(FIRST)
        p, lag = search.own, self.lag + 1  # the walk at a sample is first read at the next one
        claimed = np.ones((len(drive.force_N), 1))
        period_s = context.disturbance_period_s
        if period_s is not None and self.harmonics > 0:
            angle = 2.0 * np.pi * (record["time_s"] + 0.5 * context.sampling_time_s) / period_s
            search, waves = under_waves(context, record, paper, search, angle, period_s, self.harmonics)
            claimed = np.hstack((claimed * float(not paper.has_friction), waves))
        run, kept_share = search.run(), search.drift().kept_share
        sums = np.zeros_like(search.motion.columns)
        sums[:, p:] = paper.force_unit_N * claimed
        mean, variance = lagged_sum(search.motion, kept_share, run, sums, lag)
        mass = np.zeros_like(sums)
        mass[:, 0] = 1.0
        lighter, doubt = lagged_sum(search.motion, kept_share, run, mass, lag)
        heavier = np.array([paper.rigid(np.array([one, 0.0, 0.0, 0.0])).mass_kg for one in lighter]) / paper.mass_kg
        force = heavier * mean
        own = slice(MOTION, MOTION + p)
        b, covariance = run.states[-1, own], run.covariances[-1, own, own]
        beta, spread = parameters_with_covariance(context, drive, paper, b, covariance)
        self._shapes = found_shapes(context, paper, SHAPE_DEVIATION, b)
        return Estimate(
            parameters=dict(zip(context.nominal, beta.tolist(), strict=True)),
            covariance=spread,
            disturbance_N=force[rows],
            disturbance_variance_N2=(heavier**2 * variance + paper.deviations[0] ** 2 * doubt * force**2)[rows],
        )
