"""Input estimation by the Rauch-Tung-Striebel smoother with a friction state: the force on a drive that slides."""

from typing import ClassVar, final

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.record import Record
from fdbench_baselines._drifting_forces import CLOSE, NoiseSearch
from fdbench_baselines._found_drive import simulated_target
from fdbench_baselines._friction_motion import (
    LOOP,
    Driven,
    DriveSheet,
    declined,
    driven,
    parameters_with_covariance,
    sheet,
)
from fdbench_baselines._motion_smoother import MOTION
from fdbench_baselines._process_force import turns
from fdbench_baselines._simulated_drive import LEAST
from fdbench_baselines._walked_motion import MENDED, found_shapes, under_waves, walked

FIRST = 60  # evaluations of the likelihood
BENT = 3  # times that the friction's slopes are taken anew
FARTHEST = 1.0  # logarithm of a shape over the nominal one
RIGID = 4  # coefficients of mass, viscous and Coulomb friction, offset
CONTRADICTED = 13.28  # chi square of as many, exceeded by chance in one per cent of records


@final
class RtsFriction(BatchEstimator):
    r"""Force on a drive and its parameters from the motion itself, friction with its bristles carried along it.

    .. math::
        \dot x = v, \quad m \dot v = u - B v - \theta F(z, v) - F_0 - w - \sum_j a_j g_j(t) - \kappa, \quad
        \dot z = v - \frac{\sigma_0 |v|}{G(v)} z, \qquad y = x + e \;\text{ or }\; v + e

    with the motor's force u, which the record has, nominal friction F and its bristles z where it has them, a walk w,
    waves g and white noises e and kappa. The rows of the regression are filtered or hold no friction but its line; here
    every sample of the record counts as it is read, those of a reversal too. Read is the centre of mass of motor and
    table, where the screw is no force, or in a velocity loop the velocity. The table's readings move the bristles, so
    that their force is known up to its level and its shape, and :math:`1 / m, B / m, \theta / m, F_0 / m` and the shape
    enter linearly: they are constant states, as likely beforehand as the sheet says, shapes by ``shape_deviation``.
    Filter and smoother (`_motion_smoother`) are then exact. Slopes of the friction with level and shape are those about
    the sheet, and then about what was found, up to three times while the record becomes likelier. The walk begins at 0:
    a constant force is the offset's.

    Under a walk that is fast the likelihood weighs changes of the force: a friction's level is then told by its jumps
    at reversals, and on a drive whose friction turns gradually comes out too small, and mass, viscous friction and
    offset with it. Least squares weigh all samples alike,

    .. math:: \hat b = b + (X^T X + s^2 I)^{-1} (X^T w - s^2 b), \qquad
        V = (X^T X + s^2 I)^{-1} X^T \Omega X (X^T X + s^2 I)^{-1}

    with the accelerations X that the coefficients b make, w that the smoothed walk makes, its mean square :math:`s^2`
    and the covariance :math:`\Omega` of walk and kappa. They count on a drive with nominal friction and no period where
    mass, frictions and offset lie further apart than chance explains in one of a hundred records (Hausman's test of
    :math:`\hat b - b` against V, which is more than the variance of the difference; chi square of 4). V is then their
    covariance. Beside a cut, whose mean is in the walk too, free runs would err by 7 per cent more.

    Waves are harmonics of the nominal period, of a spindle or shaker that slips and drifts (`_process_force`): of
    amplitudes that forget, or of those of a cut, which grows with the feed and beside no friction has a mean, whichever
    is likelier. Deviations of all noises, the memory, and the variance of each harmonic are those of greatest
    likelihood. In a velocity loop a shaker's waves begin anew where they seem to jump by six deviations.

    ``disturbance_N`` is the waves and a cut's mean, smoothed over the record; without nominal friction or a period the
    walk is a part of it. ``parameters`` are those of the model, with covariance; the gain of a velocity loop is force
    over error as logged. Of an axis with inverse dynamics a free run is the simulation of the drive as found.

    Told: the sheet with its covariance, the period, the force limit as a scale; no size of force or noise. A sample
    costs 4 m^2 multiplications in each of 250 to 450 passes of m states (12 to 35), 0.1 to 0.7 ms in all; its memory is
    8 m^2 bytes.

    Parameters
    ----------
    harmonics : int
        Of the period, at least 0; in positions those below half of the sampling frequency.
    shape_deviation : float
        Relative deviation of what shapes the nominal friction, such as the stiffness of bristles; above 0. The default
        is that of ``output_error``.

    Raises
    ------
    SpecError
        If an argument is out of bounds, or the scenario is none of a drive whose force is logged.

    Validity
    --------
    The force that is logged must be that of the motor: a current loop's lag or a wrong constant is a force or a mass.
    Mass shares of motor and table are nominal. On an axis with friction the mean of a cut goes to the friction, and
    through both to the parameters; there, and where friction has another shape, stated variances are too small. In a
    velocity loop it is hardly ahead of ``state_space_gp``, and behind ``output_error`` in parameters: its gain is where
    bristles rule, on axes whose rows are filtered. On the measured EMPS axis friction turns over 15 ms and not within
    1 mm/s, and likelihood has 6.3 of 20.4 N for it. Least squares take its place (chi square 35, of half the record
    16; unknown cogging passed the bound on none of ten axes): no better there than ``least_squares``, and of wide
    variances.

    References
    ----------
    Rauch, Tung, Striebel, AIAA Journal 3 (1965), 1445-1450; Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans.
    Automatic Control 40 (1995), 419-425, eqs. (2) to (4), for z; Lourens et al., Mechanical Systems and Signal
    Processing 27 (2012), 446-460, for the force as a state; Dempster, Laird, Rubin, J. Royal Statistical Society B 39
    (1977), for variances of harmonics; de Jong and Penzer, J. American Statistical Association 93 (1998), for jumps;
    Hausman, Specification tests in econometrics, Econometrica 46 (1978), 1251-1271, section 2, for the test.

    Examples
    --------
    The mass is 1.25 times that of the data sheet, so that beta_1 is 0.4, beside a shaker of 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = RtsFriction().fit(*example_drive(mass_ratio=1.25, wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.4, 'beta_2': 0.6}
    >>> found.disturbance_N[[100, 101, -1]].round(2).tolist()  # 5 sin(2 pi t / 65 ms)
    [3.32, -1.2, 4.96]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive",)

    def __init__(self, harmonics: int = 4, shape_deviation: float = 0.2) -> None:
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"rts_friction: harmonics = {harmonics!r} must be an integer of at least 0.")
        if not 0.0 < shape_deviation < np.inf:
            raise SpecError(f"rts_friction: shape_deviation = {shape_deviation!r} must be above 0 and finite.")
        self.harmonics, self.shape_deviation = harmonics, shape_deviation
        self._shapes: dict[str, float] = {}

    def skip(self, context: Context) -> str | None:
        """Skip where there is no equation of a force on a feed drive."""
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find noises by likelihood, filter forwards and smooth backwards."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"rts_friction: {reason}.")
        drive, paper, rows = driven(context, record), sheet(context), context.regression(record).rows
        search = walked(context, drive, paper, self.shape_deviation).likeliest(FIRST)
        n, p = len(drive.force_N), search.own
        sums = np.zeros((n, p + 1))
        sums[:, p] = paper.force_unit_N
        period_s = context.disturbance_period_s
        if period_s is not None and self.harmonics > 0:
            angle = self._angle(record["time_s"], search, period_s)
            search, waves = under_waves(
                context, record, paper, search, angle, period_s, self.harmonics, starts=context.model == LOOP
            )
            walk = sums[:, p:] * float(not paper.has_friction)
            sums = np.hstack((sums[:, :p], walk, paper.force_unit_N * waves))
        search = self._bent_anew(context, drive, paper, search)
        found, last = search.smoothed(sums), search.run()
        b, covariance = (
            last.states[-1, MOTION : MOTION + p],
            last.covariances[-1, MOTION : MOTION + p, MOTION : MOTION + p],
        )
        mean, other = found.mean, None
        # Beside a process the walk holds the mean of its force, which least squares would give to the friction.
        if paper.has_friction and period_s is None:
            other = self._by_least_squares(search, b)
        if other is not None:
            moved, b, covariance = other[0] - b, *other
            with_walk = sums[:, p] / search.motion.columns[:, p]
            mean = mean - with_walk * (search.motion.columns[:, :p] @ moved)
        beta, spread = parameters_with_covariance(context, drive, paper, b, covariance)
        rigid = paper.rigid(b)
        self._shapes = found_shapes(context, paper, self.shape_deviation, b)
        heavier, doubt = rigid.mass_kg / paper.mass_kg, float(paper.deviations[0] ** 2 * covariance[0, 0])
        force = heavier * mean[rows]
        return Estimate(
            parameters=dict(zip(context.nominal, beta.tolist(), strict=True)),
            covariance=spread,
            disturbance_N=force,
            disturbance_variance_N2=heavier**2 * found.variance[rows] + doubt * force**2,
        )

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the target of an axis as it was found, simulated; in a velocity loop that of the parameters."""
        found = simulated_target(context, estimate, self._shapes, command)
        return super().predict(context, estimate, command) if found is None else found

    @staticmethod
    def _angle(time_s: FloatArray, search: NoiseSearch, period_s: float) -> FloatArray:
        """Return the angle (n,) of the first wave half a sample after each reading, in rad, as it slips and drifts."""
        # What a walk makes of waves may be none of them; the innovations, whitened, hold them in any case.
        run = search.run()
        angle = turns(time_s, run.errors / np.sqrt(run.variances), period_s)
        return angle + 0.5 * np.diff(angle, append=2.0 * angle[-1] - angle[-2])

    def _bent_anew(self, context: Context, drive: Driven, paper: DriveSheet, search: NoiseSearch) -> NoiseSearch:
        """Return the search with the friction's slopes about what was found, while that makes the record likelier."""
        for _ in range(BENT if paper.has_friction else 0):
            b = search.run().states[-1, MOTION : MOTION + search.own]
            level = max(paper.rigid(b).coulomb_N / paper.coulomb_N, 1.0 + LEAST)
            found = found_shapes(context, paper, self.shape_deviation, b)
            shapes = np.clip(list(found.values()), -FARTHEST, FARTHEST)
            bent_motion = walked(context, drive, paper, self.shape_deviation, level, shapes).motion
            columns = np.hstack((bent_motion.columns[:, : search.own], search.motion.columns[:, search.own :]))
            motion = search.motion._replace(known=bent_motion.known, columns=columns)
            other = search._replace(motion=motion).likeliest(MENDED)
            if other.log_likelihood < search.log_likelihood + CLOSE:
                break
            search = other
        return search

    @staticmethod
    def _by_least_squares(search: NoiseSearch, b: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return coefficients (p,) of least squares, their covariance under the walk, where b contradicts them."""
        p, drift, columns = search.own, search.drift(), search.motion.columns
        X, only = columns[:, :p], np.zeros_like(columns)
        only[:, p] = columns[:, p]
        walk = search.smoothed(only).mean
        ridge = float(np.mean(walk**2))
        inverse = np.linalg.pinv(X.T @ X + ridge * np.eye(p), hermitian=True)
        moved = inverse @ (X.T @ walk - ridge * b)
        later = np.cumsum((columns[:, p:][:, :1] * X)[::-1], axis=0)[::-1]
        covariance = inverse @ (drift.fresh[p] * later.T @ later + drift.kick * X.T @ X) @ inverse
        rigid = moved[:RIGID]
        distance = float(rigid @ np.linalg.pinv(covariance[:RIGID, :RIGID], hermitian=True) @ rigid)
        return (b + moved, covariance) if distance > CONTRADICTED else None
