"""Noises of greatest likelihood for a motion under a walk and waves, each wave with a variance of its own."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fdbench.estimator import FloatArray
from fdbench_baselines._motion_smoother import Drift, ForcedMotion, Passed, Smoothed, passed, smoothed

WALK_PER_ROOT_S, WAVE, MEMORY_S = 0.3, 0.15, 2.0
READING = (1.0, 0.05)  # of a position's noise, and of what a velocity changes by without a cause
STEPS = (-0.7, -1.5, -1.5, 1.0, 1.0)
SHORTEST_MEMORY_S, LONGEST_MEMORY_S = 0.5, 300.0
SURPRISE, BURST_S = 6.0, 0.2
TOLERANCE, CLOSE = 0.02, 0.5  # of a logarithm, and of the log likelihood


class NoiseSearch(NamedTuple):
    """A motion under parameters, a walk and waves, and the noises that are searched.

    Attributes
    ----------
    motion : ForcedMotion
        Whose columns are p parameters, the walk, and waves.
    own : int
        p.
    variances : (n_waves,) array
        Of the waves' amplitudes at the point 0.
    point : (3 or 5,) array
        Logarithms of deviations of reading, kick and walk about their starts; with waves theirs, and of the memory.
    step_s : float
    still : int
        How many of the last waves do not forget, as the mean force of a cut does not.
    log_likelihood : float
    """

    motion: ForcedMotion
    own: int
    variances: FloatArray
    point: FloatArray
    step_s: float
    still: int = 0
    log_likelihood: float = -np.inf

    def drift(self, point: FloatArray | None = None) -> Drift:
        """Return the noises at a point of the search, by default its best."""
        place = self.point if point is None else point
        reading, kick, walk, wave, memory = np.append(place, np.zeros(5 - len(place))).tolist()
        seconds = float(np.clip(MEMORY_S * np.exp(memory), SHORTEST_MEMORY_S, LONGEST_MEMORY_S))
        rho = float(np.exp(-self.step_s / seconds))
        waves = self.variances * np.exp(2.0 * np.clip(wave, -10.0, 5.0))
        kept_share = np.full(len(waves), rho)
        kept_share[len(waves) - self.still :] = 1.0
        walks = WALK_PER_ROOT_S**2 * self.step_s * float(np.exp(2.0 * np.clip(walk, -12.0, 8.0)))
        return Drift(
            READING[self.motion.place] ** 2 * float(np.exp(2.0 * np.clip(reading, -4.0, 5.0))),
            float(np.exp(2.0 * np.clip(kick, -8.0, 10.0))),
            np.concatenate((np.ones(self.own + 1), kept_share)),
            np.concatenate((np.zeros(self.own), [walks], waves * (1.0 - kept_share**2))),
            np.concatenate((np.ones(self.own), [0.0], waves)),
        )

    def run(self) -> Passed:
        """Return the filter at the best point."""
        return passed(self.motion, self.drift())

    def smoothed(self, sums: FloatArray) -> Smoothed:
        """Return what the smoother makes of some sums of the coefficients at the best point."""
        return smoothed(self.motion, self.drift(), self.run(), sums)

    def likeliest(self, evaluations: int) -> "NoiseSearch":
        """Return the search at the point of greatest likelihood, by the simplex of Nelder and Mead."""
        from scipy.optimize import minimize

        def loss(point: FloatArray) -> float:
            value = -float(passed(self.motion, self.drift(point), False).log_likelihood)
            return value if np.isfinite(value) else 1e300

        corners = np.vstack((self.point, self.point + np.diag(STEPS[: len(self.point)])))
        options: Any = {"initial_simplex": corners, "maxfev": evaluations, "xatol": TOLERANCE, "fatol": CLOSE}
        found = minimize(loss, self.point, method="Nelder-Mead", options=options)
        return self._replace(point=found.x, log_likelihood=-float(found.fun))

    def told(self, groups: NDArray[np.intp], starts: bool) -> "NoiseSearch":
        """Return the search with the variance of each group of waves that the record tells, and shocks in it.

        A step of expectation and maximisation. At a shock, a jump beyond `SURPRISE` deviations, waves begin anew.
        """
        found, shock = self.smoothed(np.zeros_like(self.motion.columns)), self.motion.shock.copy()
        jumps, burst = found.shocks.copy(), max(int(BURST_S / self.step_s), 1)
        while starts and float(jumps.max()) > SURPRISE**2:
            k = int(np.argmax(jumps))
            shock[k] = True
            jumps[max(k - burst, 0) : k + burst] = 0.0
        squares = found.squares[self.own + 1 :]
        means = np.bincount(groups, squares) / np.bincount(groups)
        motion = self.motion._replace(shock=shock)
        return self._replace(
            motion=motion, variances=means[groups], point=np.append(self.point[:3], [0.0, self.point[4]])
        )


def wave_columns(
    angle: FloatArray, harmonics: int, feed: FloatArray | None = None
) -> tuple[FloatArray, NDArray[np.intp]]:
    r"""Return columns (n, q) of a periodic force, and which of them have a variance in common (q,).

    Without a feed cosine and sine of each harmonic. With one, both times its sign and times itself, and last the two
    without a wave: the force on an edge is affine in the chip, and turns with the feed.

    >>> columns, groups = wave_columns(np.linspace(0.0, 9.0, 50), 2, np.ones(50))
    >>> columns.shape, groups.tolist()
    ((50, 10), [0, 0, 1, 1, 2, 2, 3, 3, 4, 5])
    """
    orders = np.repeat(np.arange(1, harmonics + 1), 2)
    turned = angle[:, None] * orders
    waves = np.where(np.arange(len(orders)) % 2 == 0, np.cos(turned), np.sin(turned))
    if feed is None:
        return waves, orders.astype(np.intp) - 1
    speed = (feed / (float(np.sqrt(np.mean(feed**2))) or 1.0))[:, None]
    columns = np.hstack((waves * np.sign(speed), waves * speed, np.sign(speed), speed))
    groups = np.concatenate((orders - 1, orders - 1 + harmonics, [2 * harmonics, 2 * harmonics + 1]))
    return columns, groups.astype(np.intp)


def with_waves(search: NoiseSearch, unit: float, waves: FloatArray, still: int = 0) -> NoiseSearch:
    """Return the search of a motion with waves in place of its own, ``unit`` being the acceleration of one."""
    columns = np.ascontiguousarray(np.hstack((search.motion.columns[:, : search.own + 1], unit * waves)))
    # What passes for a fast walk without waves is no start with them.
    point = search.point if len(search.point) == len(STEPS) else np.zeros(len(STEPS))
    variances = np.full(waves.shape[1], WAVE**2)
    return search._replace(
        motion=search.motion._replace(columns=columns),
        variances=variances,
        point=point,
        still=still,
        log_likelihood=-np.inf,
    )
