"""Kalman filter as a disturbance observer: the force is one more state, and so are parameters and oscillators."""

from array import array
from typing import ClassVar, Literal, final

import numpy as np

from fdbench.errors import PluginError, SpecError, did_you_mean
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants import StateSpacePlant
from fdbench.record import Record
from fdbench_baselines._kalman_filter import (
    OUT_COLUMNS,
    ConstantFilter,
    Observer,
    continuous_filter,
    filter_readings,
    observer,
    run_constant_filter,
    steady_filter,
)
from fdbench_baselines._kalman_regression import Stream, observe

STATE_SPACE = "state_space"
LINEAR = ("velocity_loop", "inverse_dynamics", "directional_inverse_dynamics")
FORMS = ("varying", "steady", "continuous")
FORCE_NOISES = ("van_loan", "force_only")


@final
class Kalman(OnlineEstimator):
    r"""Observer of the force, and of states or parameters, by whichever model of the plant the scenario has.

    In state space, from the readings:

    .. math::
        \frac{d}{dt} \begin{pmatrix} x \\ F \end{pmatrix} =
            \begin{pmatrix} A & E \\ 0 & 0 \end{pmatrix} \begin{pmatrix} x \\ F \end{pmatrix}
            + \begin{pmatrix} B \\ 0 \end{pmatrix} u + \begin{pmatrix} 0 \\ 1 \end{pmatrix} w, \qquad
        y = C x + v

    with a white w of density q, and the variances of the readings as the plant's data sheet gives them. Row k is the
    estimate at sample k + 1: its readings are the inputs held from sample k on and the outputs at sample k + 1.

    ``disturbance_N`` is the force, with its variance; ``output`` the first output as predicted before its reading, with
    the variance of that reading. Nothing is added to any covariance beside the noises of the model, so that units
    do not matter. Readings' noises are taken for independent.

    For a linear model, of a velocity loop or of inverse dynamics, parameters with Coulomb friction among them are
    constant states, as likely beforehand as the data sheet says, and the force is a random walk and damped oscillators:

    .. math:: y_k = z_k^T \beta + g \, \Big( m v_k + w_k + \sum_{h=1}^H c_{h,k} \Big) + e_k

    at the harmonics of the nominal period, which may slip by 1.5 %; m is the process force that grows with the feed of
    a velocity loop whose data sheet states how exact it is; of inverse dynamics under such a sheet, rows off the
    straight line of the nominal friction count as missing. Noises and memory are those of greatest likelihood
    (`_kalman_regression`); rows that stand out beyond four deviations count less, and where the filter is surprised
    by six the force begins anew, as where a tool enters. ``disturbance_N`` is smoothed over
    the record, ``parameters`` have their covariance, ``output`` is the target as predicted before it. A stream's
    estimate is that of the record so far; ``harmonics`` is the one parameter that counts here.

    Parameters
    ----------
    q_N2_per_s : float
        Density of the random walk, N^2/s; 0 keeps the force where it starts. Only q over the readings' variance shapes
        the estimate.
    form : {"varying", "steady", "continuous"}
        Covariance propagated in the form of Joseph; gain of its steady state, with everything at zero at the start; or
        gain of the continuous filter, which takes a reading's variance times the sampling time for a density.
    force_noise : {"van_loan", "force_only"}
        Whether the force drifts within a sampling time or steps at its end; for the two discrete forms.
    initial_force_N : float
        Standard deviation of the force at the start, N; for the varying form.
    harmonics : int
        H, at least 0; none where no period is known, in inverse dynamics those below half of the sampling frequency.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the regression has no readings, or there is no steady gain.
    PluginError
        If a sample comes before ``start``.

    References
    ----------
    Kalman, A new approach to linear filtering and prediction problems, J. Basic Engineering 82 (1960); Salehi, thesis,
    2013, eqs. (3.5) to (3.12) and chapter 4, where F lacks the process noise without which its gain dies out; Harvey,
    Forecasting, Structural Time Series Models and the Kalman Filter, 1989, section 2.3 (oscillators).

    Examples
    --------
    A drive that is as its data sheet says, beside a shaker of 5 N: a sine of 65 ms, at the first rows and the last.

    >>> from fdbench_baselines._example import example_drive
    >>> found = Kalman().fit(*example_drive(wave_N=5.0, period_s=0.065))
    >>> {name: round(value, 3) for name, value in found.parameters.items()}
    {'beta_1': 0.5, 'beta_2': 0.5}
    >>> [round(float(force), 2) for force in found.disturbance_N[[0, 1, -1]]]  # 5 sin(2 pi t / 65 ms)
    [0.0, 4.11, 4.96]
    """

    made_for: ClassVar[tuple[str, ...] | None] = (
        "feed_drive",
        "spindle",
    )  # of a network, kalman_central is this filter

    def __init__(
        self,
        q_N2_per_s: float = 1e4,
        form: Literal["varying", "steady", "continuous"] = "varying",
        force_noise: Literal["van_loan", "force_only"] = "van_loan",
        initial_force_N: float = 100.0,
        harmonics: int = 4,
    ) -> None:
        for name, value in (("q_N2_per_s", q_N2_per_s), ("initial_force_N", initial_force_N)):
            if not 0.0 <= value < np.inf:
                raise SpecError(f"kalman: {name} = {value!r} must be at least 0 and finite.")
        for name, choice, allowed in (("form", form, FORMS), ("force_noise", force_noise, FORCE_NOISES)):
            if choice not in allowed:
                raise SpecError(f"kalman: {name}: unknown choice '{choice}'.{did_you_mean(choice, allowed)}")
        if not isinstance(harmonics, int) or harmonics < 0:
            raise SpecError(f"kalman: harmonics = {harmonics!r} must be an integer of at least 0.")
        self.q_N2_per_s, self.form, self.force_noise = q_N2_per_s, form, force_noise
        self.initial_force_N, self.harmonics = initial_force_N, harmonics
        self._stream: Stream | None = None
        self._is_started = False

    def skip(self, context: Context) -> str | None:
        """Skip where the plant's model is neither one in state space nor one of a drive's force and motion."""
        if context.model in LINEAR or (context.model == STATE_SPACE and isinstance(context.plant, StateSpacePlant)):
            return None
        return "the scenario's model is neither one in state space nor one of a drive's motion"

    def start(self, context: Context) -> None:
        """Forget everything and find the gain."""
        reason = self.skip(context)
        if reason is not None:
            raise SpecError(f"kalman: {reason}.")
        self._is_started = True
        self._stream = Stream(context, self.harmonics) if context.model in LINEAR else None
        if self._stream is not None or not isinstance(context.plant, StateSpacePlant):
            return
        period, q = context.sampling_time_s, self.q_N2_per_s
        space = context.plant.state_space(period)
        self._n_inputs, self._n_readings = len(space.inputs), len(space.inputs) + len(space.outputs)
        self._x = np.zeros(len(space.A) + 1)
        if self.form == "continuous":
            self._filter: Observer | ConstantFilter = continuous_filter(space, period, q)
        else:
            model = observer(space, period, q, self.initial_force_N, self.force_noise == "van_loan")
            self._P = model.P.copy()
            self._filter = steady_filter(model) if self.form == "steady" else model
        self._rows = array("d")

    def update(self, sample: Sample) -> None:
        """Take in one row."""
        if self._stream is not None:
            self._stream.take(sample)
            return
        self._take(sample.readings[np.newaxis])

    def estimate(self) -> Estimate:
        """Return the estimates made so far."""
        self._check_started()
        if self._stream is not None:
            return self._stream.estimate()
        output, output_variance, force, force_variance = np.array(self._rows).reshape(-1, OUT_COLUMNS).T
        return Estimate(
            disturbance_N=force,
            disturbance_variance_N2=force_variance,
            output=output,
            output_variance=output_variance,
        )

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        self.start(context)
        if self._stream is not None:
            return observe(context, context.regression(record), self.harmonics)
        readings = context.regression(record).readings
        self._take(np.empty((0, 0)) if readings is None else readings)
        return self.estimate()

    def _take(self, readings: FloatArray) -> None:
        self._check_started()
        if readings.shape[1] != self._n_readings:
            raise SpecError(
                f"kalman: {self._n_readings} readings a row are expected, those of the plant's state space, found "
                f"{readings.shape[1]}."
            )
        u, y = (np.ascontiguousarray(part) for part in np.split(readings, [self._n_inputs], axis=1))
        if isinstance(self._filter, ConstantFilter):
            out = run_constant_filter(self._filter, self._x, u, y)
        else:
            out, _ = filter_readings(self._filter, self._x, self._P, u, y)
        self._rows.frombytes(out.tobytes())

    def _check_started(self) -> None:
        if not self._is_started:
            raise PluginError("kalman: start(context) must come before update and estimate.")
