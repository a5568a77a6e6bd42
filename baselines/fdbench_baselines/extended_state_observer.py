"""Extended state observer: the disturbance force as a state beside the velocity, from the data sheet alone."""

import math
from array import array
from typing import ClassVar, final

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench.errors import PluginError, SpecError
from fdbench.estimator import Context, Estimate, FloatArray, OnlineEstimator, Sample
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._one_step import OneStep, declined

LOOP = "velocity_loop"
FASTER, QUIET_RAD_PER_S = 10.0, 200.0


@final
class ExtendedStateObserver(OnlineEstimator):
    r"""Linear extended state observer of the nominal drive, both of its poles at one bandwidth.

    .. math::
        e_k = v_{k+1} - (a \hat v_k + b_k + g \hat F_k), \quad
        \hat v_{k+1} = v_{k+1} - (1 - l_1) e_k, \quad \hat F_{k+1} = \hat F_k + l_2 e_k / g

    .. math:: l_1 = 1 - \lambda^2 / a, \qquad l_2 = (1 - \lambda)^2, \qquad \lambda = e^{-\omega_o T}

    with the velocity v that is read, the drive's own pole a (1 without viscous friction), what command, controller and
    Coulomb friction of the data sheet add in a sample, b (m/s), the disturbance gain g (m/s per N) and the bandwidth
    :math:`\omega_o`. In current form a reading acts on its own row. Rows of inverse dynamics hold the acceleration and
    no state of a velocity: there the observer is that of reduced order, which is the disturbance observer with a
    first-order filter, for the residual r of the nominal model:

    .. math:: \hat F_{k+1} = \hat F_k + (1 - \lambda) (r_k - \hat F_k)

    Told: the data sheet; the period, for the bandwidth alone; no size of the force or the noise. ``disturbance_N`` is
    the force after each row, late by :math:`2 \lambda T / (1 - \lambda)`, about :math:`2 / \omega_o`, of a slow force
    (in reduced order half of that), which is what ``disturbance_delay`` shows; a wave that is not far below
    :math:`\omega_o` comes too small as well. ``output`` is the row as predicted. No parameters are claimed: they stay
    those of the sheet. A row costs 6 multiplications; the memory is 2 numbers, beside 16 bytes a row for the answer.

    Parameters
    ----------
    bandwidth_rad_per_s : float, optional
        :math:`\omega_o`, above 0: higher for less lag, lower for less noise. By default ten times the nominal frequency
        of the force where one is known, which a slow controller's clock makes dead beat (:math:`\lambda` near 0, the
        nominal model's residual as it is); 200 rad/s elsewhere.

    Raises
    ------
    SpecError
        If the bandwidth is not above 0 and finite.
    PluginError
        If a sample comes before ``start``.

    Validity
    --------
    Whatever the sheet has wrong is a force to it: a mass that is 5 % off, 5 % of the inertia's force while the drive
    accelerates, a friction its difference. It cannot tell a shaker from friction, nor foretell either.

    References
    ----------
    Han, From PID to active disturbance rejection control, IEEE Trans. Industrial Electronics 56 (2009), 900-906, for
    the extended state; Gao, Scaling and bandwidth-parameterization based controller tuning, Proc. American Control
    Conference 2003, 4989-4996, for the gains; Miklosovic, Radke and Gao, Discrete implementation and generalization of
    the extended state observer, Proc. American Control Conference 2006, for the current form; Ohnishi, A new servo
    method in mechatronics, Trans. Japanese Society of Electrical Engineers 107-D (1987), 83-86, for the disturbance
    observer.

    Examples
    --------
    A drive that is as its data sheet says, under a constant 5 N.

    >>> from fdbench_baselines._example import example_drive
    >>> found = ExtendedStateObserver().fit(*example_drive(force_N=5.0))
    >>> round(float(found.disturbance_N[-1]), 3)
    5.000
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("feed_drive",)

    def __init__(self, bandwidth_rad_per_s: float | None = None) -> None:
        if bandwidth_rad_per_s is not None and not 0.0 < bandwidth_rad_per_s < np.inf:
            raise SpecError(
                f"extended_state_observer: bandwidth_rad_per_s = {bandwidth_rad_per_s!r} must be above 0 and finite."
            )
        self.bandwidth_rad_per_s = bandwidth_rad_per_s
        self._state: FloatArray | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where the model is no equation of a force on a feed drive."""
        return declined(context) if isinstance(context.plant, FeedDrive) else "the plant is no feed drive"

    def start(self, context: Context) -> None:
        """Forget everything; the drive is at rest and free of force."""
        plant, reason = context.plant, self.skip(context)
        if reason is not None or not isinstance(plant, FeedDrive):
            raise SpecError(f"extended_state_observer: {reason}.")
        nominal = context.nominal
        self._beta = np.array(list(nominal.values()))
        self._step = None if nominal else OneStep(plant, context.sampling_time_s)
        step_s, protocol = context.sampling_time_s, plant.inverse_dynamics
        if self._step is not None:
            self._pole = float(self._step.from_outputs[0])
        elif context.model == LOOP:
            self._pole = nominal["beta_1"] + nominal["beta_2"]
        else:
            self._pole, step_s = 0.0, step_s * (protocol.decimation if protocol is not None else 1)
        period_s, bandwidth = context.disturbance_period_s, self.bandwidth_rad_per_s
        if bandwidth is None:
            bandwidth = QUIET_RAD_PER_S if period_s is None else FASTER * 2.0 * math.pi / period_s
        self._kept = math.exp(-bandwidth * step_s)
        self._before: FloatArray | None = None
        self._rows = array("d")
        self._state = np.zeros(2)

    def update(self, sample: Sample) -> None:
        """Take in a row."""
        regressors, target, readings = sample.regressors[np.newaxis], np.array([sample.target]), sample.readings
        self._take(regressors, target, sample.disturbance_gain, readings[np.newaxis])

    def estimate(self) -> Estimate:
        """Return the force after each of the rows so far, and the rows as predicted."""
        self._started()
        force, output = np.array(self._rows).reshape(-1, 2).T
        return Estimate(disturbance_N=force, output=output)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Run over a whole record."""
        self.start(context)
        regression = context.regression(record)
        readings = np.empty((len(regression.target), 0)) if regression.readings is None else regression.readings
        self._take(regression.regressors, regression.target, regression.disturbance_gain, readings)
        return self.estimate()

    def _take(self, regressors: FloatArray, target: FloatArray, gain: float, readings: FloatArray) -> None:
        state, known = self._started(), regressors @ self._beta
        if self._step is not None:
            known = self._step.predicted(self._before, readings)
            self._before = readings[-1]
        rows = observe(state, target - known, self._pole, self._kept)
        self._rows.frombytes(np.column_stack((rows[:, 0] / gain, target - rows[:, 1])).tobytes())

    def _started(self) -> FloatArray:
        if self._state is None:
            raise PluginError("extended_state_observer: start(context) must come before update and estimate.")
        return self._state


@kept
@njit(error_model="numpy")
def observe(state: FloatArray, left: FloatArray, pole: float, kept_share: float) -> FloatArray:
    r"""Return the disturbance g F after each row and the innovation e, (n, 2).

    Parameters
    ----------
    state : (2,) array, changed in place
        By how much the reading is above the observer's velocity, and the disturbance, both in units of the row.
    left : (n,) array
        What the nominal model leaves of each row with the reading before it: e is that and ``pole`` times the state.
    pole : float
        a; 0 for the observer of reduced order.
    kept_share : float
        :math:`\lambda`.

    >>> observe(np.zeros(2), np.ones(3), 0.0, 0.5)[:, 0]
    array([0.5 , 0.75 , 0.875])
    >>> observe(np.zeros(2), np.ones(3), 1.0, 0.5)[:, 0].round(4)
    array([0.25 , 0.5 , 0.6875])
    """
    rows = np.empty((left.size, 2))
    stays = kept_share**2 / pole if pole != 0.0 else 0.0
    share = (1.0 - kept_share) ** 2 if pole != 0.0 else 1.0 - kept_share
    for k in range(left.size):
        error = left[k] + pole * state[0] - state[1]
        state[0] = stays * error
        state[1] += share * error
        rows[k, 0], rows[k, 1] = state[1], error
    return rows
