"""The three predictions of a record by a model: closed loop, inverse dynamics, one step ahead."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evaluation.effect_forces import EffectForces
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.low_pass import low_passed
from fdbench.diagnosis.records.plausibility import noise_estimate
from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun
from fdbench.effects import Port
from fdbench.errors import RecordError
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray

BAND_HZ = 40.0  # widest band of the inverse dynamics
LOUD = 0.02  # of the measured force that the noise of the position may reach by its second derivative
OF_NYQUIST = 0.4
WIDER, WIDEST_OF_NYQUIST = 2.0, 0.8  # band of the position, which has to leave that of the forces as it is
SETTLED = 2.0  # periods of the band's edge at either end that the filter does not know


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Measured and predicted channels of a run, from sample ``first`` on; the two have the same length."""

    first: int
    measured: dict[str, FloatArray]
    predicted: dict[str, FloatArray]

    def after(self, n_samples: int) -> "Prediction":
        """Return it without its first samples."""
        measured, predicted = (
            {name: values[n_samples:] for name, values in channels.items()}
            for channels in (self.measured, self.predicted)
        )
        return Prediction(first=self.first + n_samples, measured=measured, predicted=predicted)


def closed_loop(replay: Replay, run: RecordedRun) -> Prediction:
    """Return what the model makes of the command of a run, from the measured start on."""
    simulated = replay.simulate(run, [Variant(plant=replay.drive)])
    return Prediction(first=0, measured=run.channels, predicted={name: own[0] for name, own in simulated.items()})


def lumped(drive: FeedDrive, run: RecordedRun) -> FeedDrive:
    """Return the drive as it is seen by the sensors of a run: one mass, unless both sides of a screw were measured."""
    return drive if DEFLECTION in run.channels else dataclasses.replace(drive, screw=None)


def sides(drive: FeedDrive, run: RecordedRun) -> tuple[FloatArray, FloatArray]:
    """Return the positions of motor and table; of one mass they are the same."""
    position = run.channels["position_m"]
    stretch = run.channels.get(DEFLECTION)
    if stretch is None:
        return position, position
    return (position + stretch, position) if drive.controller.uses_table else (position, position - stretch)


# ---- inverse dynamics ----


def useful_band_Hz(drive: FeedDrive, run: RecordedRun) -> float:
    r"""Return up to which frequency the force of the inverse dynamics is not noise.

    White noise of the position, of standard deviation s, makes in the band up to f a force of
    :math:`M (2 \pi f)^2 s \sqrt{f / (5 f_N)}` with the Nyquist frequency :math:`f_N`; that reaches 2 % of the measured
    force at the end of the band. At most 40 Hz and 0.4 of the Nyquist frequency.
    """
    nyquist = 0.5 / run.period_s
    widest = min(BAND_HZ, OF_NYQUIST * nyquist)
    noise_m = noise_estimate(run.channels["position_m"])
    loud_N = LOUD * float(np.std(run.channels["motor_force_N"]))
    per_band = drive.mass_kg * (2.0 * math.pi) ** 2 * noise_m / math.sqrt(5.0 * nyquist)
    return min(widest, (loud_N / per_band) ** 0.4) if per_band > 0.0 and loud_N > 0.0 else widest


def inverse_dynamics(drive: FeedDrive, run: RecordedRun, band_Hz: float, loops: int = 1) -> Prediction:
    r"""Return the motor force that the model needs for the measured motion.

    .. math:: F = m_m \ddot x_m + B_m \dot x_m + f_m + m_t \ddot x_t + B_t \dot x_t + f_t

    The positions are low-passed without delay up to twice the band, and their derivatives taken in the middle between
    samples, where a force that is held acts on average; then both forces are low-passed alike up to the band. f_m, f_t:
    the effects that the model knows. Of a controller that acts ``loops`` times between two samples a logged force holds
    for a part of that time; in the middle it is between that and the next.

    Raises
    ------
    RecordError
        If the record is too short for the band.
    """
    drive, h = lumped(drive, run), run.period_s
    margin = math.ceil(SETTLED / (band_Hz * h))
    if run.n_samples < 4 * margin:
        raise RecordError(
            f"{run.name}: {run.n_samples} samples are too few for inverse dynamics up to {band_Hz:.3g} Hz; needed are "
            f"{4 * margin}."
        )
    wide_Hz = min(WIDER * band_Hz, WIDEST_OF_NYQUIST * 0.5 / h)
    motion = [_middle(low_passed(position, wide_Hz, h), h) for position in sides(drive, run)]
    force, later = run.channels["motor_force_N"], 0.5 * (1.0 - 1.0 / loops)
    command, commanded = (1.0 - later) * force[1:-2] + later * force[2:-1], run.reference[1:-2, 1]
    table = drive.table
    motor_kg, motor_drag = drive.motor.mass_kg, drive.motor.viscous_friction_N_s_per_m
    table_kg, table_drag = (table.mass_kg, table.viscous_friction_N_s_per_m) if table is not None else (0.0, 0.0)
    forces = EffectForces(drive, h)
    measured, needed = np.empty(len(command)), np.empty(len(command))
    for k, ((x_m, v_m, a_m), (x_t, v_t, a_t), asked, wanted) in enumerate(
        zip(*(part.tolist() for part in motion), command.tolist(), commanded.tolist(), strict=True)
    ):
        t = (k + 1.5) * h
        measured[k] = forces.delivered(t, x_m, v_m, asked, wanted)
        linear_t = table_kg * a_t + table_drag * v_t
        f_m, _ = forces.against(Port.MOTOR_FORCE, t, x_m, v_m, measured[k], wanted)
        f_t, _ = forces.against(Port.TABLE_FORCE, t, x_t, v_t, linear_t, wanted)
        added, _ = forces.against(Port.TABLE_INERTIA, t, x_t, v_t, a_t, wanted)
        needed[k] = motor_kg * a_m + motor_drag * v_m + f_m + linear_t + f_t + added
    inside = slice(margin, len(command) - margin)
    both = [low_passed(values, band_Hz, h)[inside] for values in (measured, needed)]
    return Prediction(first=1 + margin, measured={"motor_force_N": both[0]}, predicted={"motor_force_N": both[1]})


def _middle(x: FloatArray, h: float) -> FloatArray:
    """Return position, velocity and acceleration in the middle of samples 1 and 2, 2 and 3, ..., (n - 3, 3)."""
    acceleration = (x[3:] - x[2:-1] - x[1:-2] + x[:-3]) / (2.0 * h**2)
    return np.column_stack((0.5 * (x[2:-1] + x[1:-2]), (x[2:-1] - x[1:-2]) / h, acceleration))


# ---- one step ahead ----


def one_step_ahead(drive: FeedDrive, run: RecordedRun) -> Prediction:
    r"""Return position and velocity one sample on, from the two samples before and the measured force.

    With the exact propagation :math:`z_{k+1} = A z_k + B w_k + C f_k` of the positions z and velocities w under forces
    that are held, the velocities follow from two positions, :math:`w_{k-1} = B^{-1} (z_k - A z_{k-1} - C f_{k-1})`, and
    from these the next position: the predictor of the linear model for white equation errors (Ljung 1999, section 3.2).
    f: the motor's force and those of the effects, at the middle of the sample as predicted. The velocity is the mean
    over a sample.
    """
    drive, h = lumped(drive, run), run.period_s
    n = 1 if drive.screw is None else 2
    flow, half = (drive.mechanics().propagators(step).reshape(4, 6) for step in (h, 0.5 * h))
    x_rows, v_rows = [0, 2][:n], [1, 3][:n]
    A, B, C = flow[np.ix_(x_rows, x_rows)], flow[np.ix_(x_rows, v_rows)], flow[x_rows][:, 4:]
    D, E, G = flow[np.ix_(v_rows, x_rows)], flow[np.ix_(v_rows, v_rows)], flow[v_rows][:, 4:]
    back = np.linalg.inv(B)
    z = np.column_stack(sides(drive, run))[:, :n]
    effects, commanded = EffectForces(drive, h), run.reference[:, 1].tolist()
    force = run.channels["motor_force_N"].tolist()
    predicted = np.empty((run.n_samples - 2, n))
    acting, against = np.array([force[0], 0.0]), np.zeros(2)
    state = np.empty(4)
    for k in range(1, run.n_samples - 1):
        before = back @ (z[k] - A @ z[k - 1] - C @ acting)
        w = D @ z[k - 1] + E @ before + G @ acting
        state[[0, 2]], state[[1, 3]] = z[k], w
        delivered = effects.delivered((k + 0.5) * h, state[0], state[1], force[k], commanded[k])
        against = _acting(effects, half, state, delivered, against, (k + 0.5) * h, commanded[k])
        acting = np.array([delivered, 0.0]) - against
        predicted[k - 1] = A @ z[k] + B @ w + C @ acting
    own = 1 if n == 2 and drive.controller.uses_table else 0
    velocities = [(later[:, own] - z[1:-1, own]) / h for later in (z[2:], predicted)]
    measured = {"position_m": z[2:, own], "velocity_m_per_s": velocities[0]}
    found = {"position_m": predicted[:, own], "velocity_m_per_s": velocities[1]}
    if n == 2:
        measured[DEFLECTION], found[DEFLECTION] = z[2:, 0] - z[2:, 1], predicted[:, 0] - predicted[:, 1]
    return Prediction(first=2, measured=measured, predicted=found)


def _acting(
    effects: EffectForces,
    half: FloatArray,
    state: FloatArray,
    delivered: float,
    last: FloatArray,
    t: float,
    commanded: float,
) -> FloatArray:
    """Return the forces against motion on motor and table over a sample, linearly implicit as in the integrator."""
    x_m, v_m, x_t, v_t = (half[:, :4] @ state + half[:, 4:] @ (np.array([delivered, 0.0]) - last)).tolist()
    per_half = 0.5 * effects.period_s
    f_m, s_m = effects.against(Port.MOTOR_FORCE, t, x_m, v_m, delivered, commanded)
    f_t, s_t = effects.against(Port.TABLE_FORCE, t, x_t, v_t, delivered, commanded)
    added_N, added_kg = effects.against(Port.TABLE_INERTIA, t, x_t, v_t, (v_t - float(state[3])) / per_half, commanded)
    slopes = np.array([[s_m], [s_t + added_kg / per_half]])
    change = np.array([f_m, f_t + added_N]) - last
    return np.asarray(last + np.linalg.solve(np.eye(2) + slopes * half[[1, 3], 4:], change))
