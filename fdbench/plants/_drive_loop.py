"""The linear control loop of a feed drive: mechanics, linear parts of effects, delay, sampling and controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.effects import Effect, LinearPart, Port
from fdbench.errors import SpecError
from fdbench.plants._friction_curve import friction_line
from fdbench.plants._linear_system import LinearSystem
from fdbench.record import FloatArray
from fdbench.simulate.block import Mechanics
from fdbench.simulate.exponential import exponential
from fdbench.simulate.stability import check_finite, check_loop

OUTPUTS = ("motor_position_m", "motor_velocity_m_per_s", "table_position_m", "table_velocity_m_per_s")


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class DrivePlant:
    r"""Mechanics with the linear parts of effects, :math:`\dot q = A q + b F(t - t_d), \; y = C q`.

    y are position and velocity of motor and table, F is the force asked of the motor. Of friction there is its slope at
    speed, between half the velocity limit and all of it; a linear model knows no reversal.

    Attributes
    ----------
    A, B, C : (n, n), (n,), (4, n) arrays
    delay_s : float
        t_d.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    delay_s: float

    def sampled(self, period_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        r"""Return A, b, C at the samples for a force that is held over each sampling time T.

        With :math:`t_d = d T + \tau, \; 0 \le \tau < T`,

        .. math::
            q_{k+1} = e^{A T} q_k + \int_0^{T-\tau} e^{A s} ds\, b\, F_{k-d}
                      + e^{A (T-\tau)} \int_0^{\tau} e^{A s} ds\, b\, F_{k-d-1},

        the forces that are still to act being states. Source: Astrom, Wittenmark (1997), Computer-Controlled Systems,
        eq. (2.12).
        """
        n, whole = len(self.A), int(self.delay_s / period_s * (1.0 + 1e-12))
        rest = max(self.delay_s - whole * period_s, 0.0)
        after, before = self._held(period_s - rest), self._held(rest)
        n_late = whole + (1 if rest > 1e-9 * period_s else 0)
        A, B = np.zeros((n + n_late, n + n_late)), np.zeros(n + n_late)
        A[:n, :n] = self._held(period_s)[:, :n]
        forces = [after[:, n], after[:, :n] @ before[:, n]]  # of d and d + 1 samples ago
        for age, column in zip((whole, whole + 1), forces, strict=True):
            if age == 0:
                B[:n] += column
            elif age <= n_late:
                A[:n, n + age - 1] += column
        if n_late:
            B[n] = 1.0
            A[n + 1 :, n:-1] += np.eye(n_late - 1)
        return A, B, np.hstack((self.C, np.zeros((len(self.C), n_late))))

    def _held(self, duration_s: float) -> FloatArray:
        """Return (n, n + 1): the state after a time, from the state and from a constant force."""
        n = len(self.A)
        generator = np.zeros((n + 1, n + 1))
        generator[:n, :n], generator[:n, n] = self.A, self.B
        return exponential(generator * duration_s)[:n]


def drive_plant(
    mechanics: Mechanics, table_mass_kg: float, effects: Sequence[Effect], velocity_limit_m_per_s: float
) -> DrivePlant:
    """Return the linear plant of an axis.

    Parameters
    ----------
    mechanics : Mechanics
    table_mass_kg : float
        Mass that forces on the table move.
    effects : sequence of Effect
        Of the nominal model; each enters by its `Effect.linear_part`, a friction without one by its slope.
    velocity_limit_m_per_s : float

    Raises
    ------
    SpecError
        If masses and stiffnesses are too large or too small to compute with.
    """
    check_finite("plant", mechanics.A, mechanics.B)
    n = 2 if mechanics.rigid else 4
    table = n - 2  # a rigid axis has one pair of states for both sides
    A, B = mechanics.A[:n, :n].copy(), mechanics.B[:n].copy()
    parts = [(effect, effect.linear_part()) for effect in sorted(effects, key=lambda effect: effect.rank)]
    if not mechanics.rigid:
        kept = float(
            np.prod([1.0 - _gain(part) for effect, part in parts if part and effect.port is Port.TRANSMISSION])
        )
        k, c = mechanics.stiffness_N_per_m * (kept - 1.0), mechanics.damping_N_s_per_m * (kept - 1.0)
        A += (B[:, 1] - B[:, 0])[:, None] * np.array([k, c, -k, -c])
    for side, port in ((0, Port.MOTOR_FORCE), (table, Port.TABLE_FORCE)):
        rest = tuple(effect for effect, part in parts if effect.port is port and part is None)
        slope = friction_line(rest, velocity_limit_m_per_s, 0.0).viscous_N_s_per_m
        A[:, side + 1] -= B[:, int(port is Port.TABLE_FORCE)] * slope
    added = sum(_gain(part) for effect, part in parts if part and effect.port is Port.TABLE_INERTIA)
    share = table_mass_kg / (table_mass_kg + added)
    A[table + 1] *= share
    B[table + 1] *= share
    plant = A, B[:, 0], np.eye(4)[:, :n] if n == 4 else np.vstack((np.eye(2), np.eye(2)))
    delay_s = 0.0
    for effect, part in parts:
        if part is None:
            continue
        if effect.port is Port.COMMAND:
            plant = _behind(part, *plant)
            delay_s += part.delay_s
        elif effect.port in (Port.MOTOR_FORCE, Port.TABLE_FORCE):
            on_table = effect.port is Port.TABLE_FORCE
            plant = _fed_back(part, B[:, int(on_table)], (table if on_table else 0) + 1, *plant)
    return DrivePlant(A=plant[0], B=plant[1], C=plant[2], delay_s=delay_s)


def _gain(part: LinearPart) -> float:
    return part.numerator[0] / part.denominator[0]


def _states(part: LinearPart) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return A, b, c, d of a linear part in controller form."""
    lead, n = part.denominator[0], len(part.denominator) - 1
    a = np.array(part.denominator[1:]) / lead
    b = np.concatenate((np.zeros(n + 1 - len(part.numerator)), part.numerator)) / lead
    A = np.eye(n, k=-1)
    A[:1] = -a
    return A, np.eye(n)[:, 0] if n else np.zeros(0), b[1:] - b[0] * a, float(b[0])


def _behind(part: LinearPart, A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a plant whose force goes through a linear part first."""
    own, b, c, d = _states(part)
    n, extra = len(A), len(own)
    joined = np.block([[A, np.outer(B, c)], [np.zeros((extra, n)), own]])
    return joined, np.concatenate((d * B, b)), np.hstack((C, np.zeros((len(C), extra))))


def _fed_back(
    part: LinearPart, force: FloatArray, velocity: int, A: FloatArray, B: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a plant on which a linear part acts as a force against the velocity in a row."""
    own, b, c, d = _states(part)
    n, extra = len(A), len(own)
    against = np.concatenate((force, np.zeros(n - len(force))))
    seen = np.eye(n)[velocity]
    joined = np.block([[A - d * np.outer(against, seen), -np.outer(against, c)], [np.outer(b, seen), own]])
    return joined, np.concatenate((B, np.zeros(extra))), np.hstack((C, np.zeros((len(C), extra))))


@final
class DriveLoop:
    r"""A drive's plant at its samples with the controller of `fdbench.simulate.integrator`.

    .. math::
        e_k = k_v v_{r,k} + K_x (x_{r,k} - x_k) - \hat v_k, \quad F_k = K_p e_k + K_i I_k + m_{ff} a_{r,k}, \quad
        I_{k+1} = I_k + T e_k

    x is read on the side that closes the loop; :math:`\hat v` is the filtered difference of its own reading over 1 or 2
    samples, or a tachometer's. A position loop that acts every n-th sample is a loop of its own, around the closed
    velocity loop n samples on. The force limit is left out.

    Parameters
    ----------
    plant : DrivePlant
    rows : mapping of str to float
        Of the controller, as ``controller.rows()`` gives them.
    period_s : float
    """

    def __init__(self, plant: DrivePlant, rows: Mapping[str, float], period_s: float) -> None:
        A, B, C = plant.sampled(period_s)
        own, turning = (2 if rows.get(name, 0.0) else 0 for name in ("USE_TABLE", "VELOCITY_OF_TABLE"))
        span, filter_s = round(rows.get("DIFFERENCE_SPAN", 0.0)), rows.get("VELOCITY_FILTER", 0.0)
        n, filtered = len(A), int(filter_s > 0.0)
        width = n + span + filtered
        self.A, self.B = np.zeros((width, width)), np.concatenate((B, np.zeros(span + filtered)))
        self.A[:n, :n] = A
        self.position, read, self.velocity = (
            np.concatenate((C[row], np.zeros(width - n))) for row in (own, turning, turning + 1)
        )
        if span:  # the readings one and two samples ago
            self.A[n] = read
            self.A[n + 1 : n + span, n : n + span - 1] += np.eye(span - 1)
            self.velocity = (read - np.eye(width)[n + span - 1]) / (span * period_s)
        if filtered:  # the velocity one sample ago
            kept = filter_s / (period_s + filter_s)
            self.velocity = (1.0 - kept) * self.velocity + kept * np.eye(width)[-1]
            self.A[-1] = self.velocity
        self.position_loop_cycles = max(round(rows.get("POSITION_LOOP_CYCLES", 1.0)), 1)
        self.plant, self.period_s = plant, period_s
        self.position_gain, self.feedforward = rows.get("POSITION_GAIN", 0.0), rows.get("VELOCITY_FEEDFORWARD", 0.0)
        self.velocity_gain, self.integral_gain = rows.get("VELOCITY_GAIN", 0.0), rows.get("INTEGRAL_GAIN", 0.0)
        self.acceleration_feedforward = rows.get("ACCELERATION_FEEDFORWARD", 0.0)
        self.velocity_reference_delay = rows.get("VELOCITY_REFERENCE_DELAY", 0.0)

    def controlled(self, measured: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, b, c from the motor's force to the force that the velocity controller asks for.

        ``measured`` (n,) is what the controller is fed, a velocity; its integral, if it has one, is the last state.
        """
        if self.integral_gain == 0.0:
            return self.A, self.B, self.velocity_gain * measured
        n = len(self.A)
        A = np.block([[self.A, np.zeros((n, 1))], [self.period_s * measured[None], np.ones((1, 1))]])
        c = np.append(self.velocity_gain * measured, self.integral_gain)
        return A, np.append(self.B, 0.0), c

    def broken_at_force(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, b, c of both loops together, broken at the motor's force; of a velocity loop that is faster, alone.

        What is fed back twice with two clocks has no response to one frequency.
        """
        if self.position_loop_cycles > 1:
            return self.controlled(self.velocity)
        return self.controlled(self.velocity + self.position_gain * self.position)

    def broken_at_velocity(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        r"""Return A, b, c of the position loop, from one of its cycles to the next, broken at the velocity it asks for.

        .. math:: A = A_v^n, \quad b = \sum_{k=0}^{n-1} A_v^k b_v

        with the closed velocity loop :math:`A_v, b_v` of each of its n samples, in which that velocity is held.
        """
        A, B, c = self.controlled(self.velocity)
        wanted = self._wanted(B)
        closed, held = A - np.outer(B, c), wanted
        flow = closed
        for _ in range(self.position_loop_cycles - 1):
            held = closed @ held + wanted
            flow = closed @ flow
        return flow, held, self.position_gain * np.append(self.position, np.zeros(len(A) - len(self.position)))

    def _wanted(self, force: FloatArray) -> FloatArray:
        """Return what a wanted velocity adds to the states of the velocity loop in a sample, from what a force does."""
        wanted = self.velocity_gain * force
        if self.integral_gain != 0.0:
            wanted[-1] = -self.period_s
        return wanted

    def check(self) -> None:
        """Raise a SpecError where a loop is unstable, with words that say by how much."""
        check_loop(*self.broken_at_force(), self.period_s)
        if self.position_loop_cycles > 1:
            check_loop(*self.broken_at_velocity(), self.position_loop_cycles * self.period_s)

    def linear_system(self) -> LinearSystem:
        """Return the plant, its loops and the closed loop as systems of python-control.

        Raises
        ------
        SpecError
            If the position loop is slower than the velocity loop: there is no system with one clock.
        """
        import control

        if self.position_loop_cycles > 1:
            raise SpecError(
                f"controller.position_loop_cycles: {self.position_loop_cycles}. Two loops with clocks of their own "
                "have no linear model with one; a position loop in each cycle (1) has."
            )
        continuous = control.ss(
            self.plant.A, self.plant.B[:, None], self.plant.C, 0, inputs=["motor_force_N"], outputs=list(OUTPUTS)
        )
        clock = self.period_s
        if self.velocity_gain == 0.0:
            return LinearSystem(plant=continuous, sampling_time_s=clock, delay_s=self.plant.delay_s)

        def system(A: FloatArray, B: FloatArray, C: FloatArray) -> control.StateSpace:
            return control.ss(A, np.reshape(B, (len(A), -1)), C[None], 0, clock)

        def wide(row: FloatArray, A: FloatArray) -> FloatArray:
            return np.append(row, np.zeros(len(A) - len(row)))

        A, B, c = self.controlled(self.velocity)
        loops = {"velocity": system(A, B, c)}
        wanted = self._wanted(B)
        if self.position_gain > 0.0:
            loops["position"] = system(A - np.outer(B, c), wanted, self.position_gain * wide(self.position, A))
            A, B, c = self.broken_at_force()
            loops["both, at the motor's force"] = system(A, B, c)
        velocity = self.feedforward * wanted
        acceleration = self.acceleration_feedforward * B - self.velocity_reference_delay * velocity
        commands = np.column_stack((self.position_gain * wanted, velocity, acceleration))
        closed = system(A - np.outer(B, c), commands, wide(self.position, A))
        return LinearSystem(
            plant=continuous, sampling_time_s=clock, delay_s=self.plant.delay_s, loops=loops, closed=closed
        )
