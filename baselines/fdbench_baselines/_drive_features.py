"""Candidates of a sparse regression on a drive: what may act on it beside mass and straight friction."""

from typing import NamedTuple

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression
from fdbench.record import Record

WIDTHS = (0.003, 0.02, 0.1, 0.3)  # of a friction curve, as a share of the largest speed
LEAD_HARMONICS = 2
VELOCITY_COLUMNS = {
    "velocity_loop": (1,),
    "inverse_dynamics": (1,),
    "directional_inverse_dynamics": (1, 3),
}


class Library(NamedTuple):
    """Functions of velocity and position, in units of the largest ones of a record.

    Attributes
    ----------
    speed_m_per_s, reach_m, centre_m : float
        Largest speed, half of the travel and its middle.
    lead_m : float or None
        Lead of the screw, where there is one.
    """

    speed_m_per_s: float
    reach_m: float
    centre_m: float
    lead_m: float | None

    def friction(self, velocity: FloatArray) -> FloatArray:
        r"""Return functions of the velocity, (n, 2 + 2 widths).

        :math:`v|v|, |v|`, and for each width :math:`\\tanh(v/w)` and :math:`\\tanh(v/w)\\, e^{-|v|/w}`.
        """
        v = velocity / self.speed_m_per_s
        columns = [v * np.abs(v), np.abs(v)]
        for width in WIDTHS:
            step = np.tanh(v / width)
            columns += [step, step * np.exp(-np.abs(v) / width)]
        return np.column_stack(columns)

    def place(self, position: FloatArray) -> FloatArray:
        """Return functions of the position: powers up to the third, and harmonics of the lead."""
        x = (position - self.centre_m) / self.reach_m
        columns = [x, x**2, x**3]
        for harmonic in range(1, LEAD_HARMONICS + 1 if self.lead_m else 1):
            angle = 2.0 * np.pi * harmonic * position / (self.lead_m or 1.0)
            columns += [np.cos(angle), np.sin(angle)]
        return np.column_stack(columns)

    def all(self, velocity: FloatArray, position: FloatArray) -> FloatArray:
        """Return the functions of velocity, then those of position."""
        return np.hstack((self.friction(velocity), self.place(position)))


def library(context: Context, velocity: FloatArray, position: FloatArray) -> Library:
    """Return the candidates in units of a record's motion."""
    low, high = float(position.min()), float(position.max())
    return Library(
        speed_m_per_s=float(np.max(np.abs(velocity))) or 1.0,
        reach_m=0.5 * (high - low) or 1.0,
        centre_m=0.5 * (high + low),
        lead_m=getattr(getattr(context.plant, "motor", None), "lead_m", None),
    )


def motion(record: Record, regression: Regression, model: str) -> tuple[FloatArray, FloatArray]:
    """Return velocity and position of each row."""
    columns = regression.regressors[:, VELOCITY_COLUMNS[model]]
    return np.asarray(columns.sum(axis=1)), record["motor_position_m"][regression.rows]


def waves(time_s: FloatArray, period_s: float, harmonics: int, envelope_s: float) -> FloatArray:
    """Return cosine and sine of each harmonic times hats in time, ``envelope_s`` apart: amplitudes that may change."""
    elapsed = (time_s - time_s[0]) / envelope_s
    knots = np.arange(int(np.ceil(elapsed[-1])) + 1)
    hats = np.maximum(0.0, 1.0 - np.abs(elapsed[:, None] - knots))
    parts = []
    for harmonic in range(1, harmonics + 1):
        angle = 2.0 * np.pi * harmonic * time_s / period_s
        parts += [hats * np.cos(angle)[:, None], hats * np.sin(angle)[:, None]]
    return np.hstack(parts) if parts else np.empty((len(time_s), 0))


def straight_line(values: FloatArray, half: float) -> FloatArray:
    r"""Return slope, level for v > 0 and level for v < 0, (3, n), of curves known at -2h, -h, h and 2h, (4, n).

    >>> straight_line(np.array([[-5.0], [-4.0], [4.0], [5.0]]), 1.0).ravel().round(12)  # v + 3 sign(v)
    array([ 1.,  3., -3.])
    """
    v = half * np.array([-2.0, -1.0, 1.0, 2.0])
    design: FloatArray = np.column_stack((v, np.maximum(np.sign(v), 0.0), np.maximum(-np.sign(v), 0.0)))
    return np.asarray(np.linalg.lstsq(design, values, rcond=None)[0])


def on_parameters(line: FloatArray) -> dict[str, float]:
    """Return what a curve of the target, as a straight line (3,), adds to each parameter of a drive's models."""
    slope, above, below = line.tolist()
    return {
        "beta_2": slope,
        "beta_3": -above,
        "beta_4": below,
        "viscous_friction_N_s_per_m": slope,
        "coulomb_friction_N": 0.5 * (above - below),
        "offset_N": 0.5 * (above + below),
        "viscous_friction_positive_N_s_per_m": slope,
        "coulomb_friction_positive_N": above,
        "viscous_friction_negative_N_s_per_m": slope,
        "coulomb_friction_negative_N": -below,
    }
