"""Input estimation by the Rauch-Tung-Striebel smoother: the force of a plant in state space, from the whole record."""

from typing import ClassVar, final

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate
from fdbench.record import Record
from fdbench_baselines._force_densities import ForceStart, declined, likeliest
from fdbench_baselines._steady_smoother import filtered

FORCE = -1


@final
class RtsSmoother(BatchEstimator):
    r"""Force of a plant in state space as a random walk, given all readings, those that follow included.

    .. math::
        \frac{d}{dt} \begin{pmatrix} x \\ F \end{pmatrix} =
            \begin{pmatrix} A & E \\ 0 & 0 \end{pmatrix} \begin{pmatrix} x \\ F \end{pmatrix}
            + \begin{pmatrix} B \\ 0 \end{pmatrix} u + \begin{pmatrix} 0 \\ 1 \end{pmatrix} w, \qquad
        y = C x + v

    the model of ``kalman`` and of the filters of a network, whose estimate lags where a force rises, as it knows
    nothing of what comes; the smoother (`_steady_smoother`) has no lag. The density q of w is that of greatest
    likelihood, with it a factor on the process noise of the plant, where it has one, and a factor on all variances.
    Without the second a plant that differs from its data sheet, such as by friction, passes for exact, and what its
    states integrate over the record is taken for force. The last factor is near 1 beforehand, its logarithm within
    log 100: in a record so quiet that only what the plant is off by is left, no readings' noise is likely as well,
    and q without bound.

    ``disturbance_N`` of a row is the mean of the smoothed force at its two ends, with the variance of one of them.

    Parameters
    ----------
    q_N2_per_s, process_factor : float
        Where the search for greatest likelihood starts; above 0.
    initial_force_N : float
        Standard deviation of the force at the start, N; above 0.

    Raises
    ------
    SpecError
        If an argument is out of bounds, the regression has no readings, or there is no steady gain.

    Validity
    --------
    The gain is the steady one from the first row on, as if the record went on from an earlier one. A mode with another
    gain than on the data sheet scales the force, which the variance does not hold.

    References
    ----------
    Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3 (1965), 1445-1450;
    Lourens, Reynders, De Roeck, Degrande, Lombaert, An augmented Kalman filter for force identification in structural
    dynamics, Mechanical Systems and Signal Processing 27 (2012), 446-460 (the force as a random walk).

    Examples
    --------
    A constant force on a spindle and a drive, read without noise for 0.2 s.

    >>> from fdbench_baselines._example import example_network
    >>> found = RtsSmoother().fit(*example_network(force_N=10.0))
    >>> found.disturbance_N[[500, 1000, -1]].round(2).tolist()
    [10.0, 10.0, 10.0]
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("sensor_network", "spindle")

    def __init__(self, q_N2_per_s: float = 1e5, process_factor: float = 20.0, initial_force_N: float = 100.0) -> None:
        given = {"q_N2_per_s": q_N2_per_s, "process_factor": process_factor, "initial_force_N": initial_force_N}
        for name, value in given.items():
            if not 0.0 < value < np.inf:
                raise SpecError(f"rts_smoother: {name} = {value!r} must be above 0 and finite.")
        self.q_N2_per_s, self.process_factor, self.initial_force_N = q_N2_per_s, process_factor, initial_force_N

    def skip(self, context: Context) -> str | None:
        """Skip where the plant's model is not one in state space."""
        return declined(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Find both densities by likelihood, filter forwards and smooth backwards."""
        begin = ForceStart(self.q_N2_per_s, self.process_factor, self.initial_force_N)
        force, variance = filtered(*likeliest("rts_smoother", context, record, begin)).smoothed(FORCE)
        force[1:] = 0.5 * (force[1:] + force[:-1])
        return Estimate(disturbance_N=force, disturbance_variance_N2=np.full(len(force), variance))
