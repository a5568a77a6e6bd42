"""Inverse dynamics of a rigid axis from position and force: M a + F_v v + F_c sign(v) + offset = F.

Protocol of Janot, Gautier, Brunot (2019): zero-phase low-pass filter, central differences, decimation of every
regressor and of the force.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import RecordError
from fdbench.plants._friction_curve import FrictionLine
from fdbench.plants._plant import LinearModel
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.specification import bounded, check_bounds, positive

FloatArray = NDArray[np.float64]
BUTTERWORTH_ORDER = 4
CHEBYSHEV_ORDER, CHEBYSHEV_RIPPLE_DB, CHEBYSHEV_EDGE = 8, 0.05, 0.8


@final
@dataclass(frozen=True, kw_only=True)
class InverseDynamics:
    """How positions are turned into accelerations.

    Parameters
    ----------
    cutoff_frequency_Hz : float
        Edge of the zero-phase Butterworth filter of order 4 on the position.
    decimation : int
        Every how many samples a row is kept, after a zero-phase Chebyshev filter of order 8 (0.05 dB) at 0.8 of the new
        Nyquist frequency; 1 keeps all.
    transient_samples : int
        Samples dropped at the start, before the decimation.
    """

    cutoff_frequency_Hz: float = positive()
    decimation: int = bounded(1, 1000)
    transient_samples: int = bounded(0, 100000)

    def __post_init__(self) -> None:
        check_bounds(self)

    def columns(
        self, position: FloatArray, force: FloatArray, period_s: float, directional: bool
    ) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
        """Return regressors (n_rows, 4 or 5), force (n_rows,) and the sample of each row."""
        from scipy import signal

        nyquist = 0.5 / period_s
        if self.cutoff_frequency_Hz >= nyquist:
            raise RecordError(
                f"cutoff_frequency_Hz = {self.cutoff_frequency_Hz:g} is not below the record's Nyquist frequency "
                f"of {nyquist:g} Hz."
            )
        # In sections: one polynomial of a low cutoff leaves half of the digits, another half on another processor.
        low_pass = signal.butter(BUTTERWORTH_ORDER, self.cutoff_frequency_Hz / nyquist, output="sos")
        smooth = signal.sosfiltfilt(low_pass, position, padtype="odd", padlen=3 * BUTTERWORTH_ORDER)
        velocity = np.gradient(smooth, period_s)
        acceleration = np.gradient(velocity, period_s)
        forward = 0.5 * (1.0 + np.sign(velocity))
        backward = 0.5 * (1.0 - np.sign(velocity))
        if directional:
            regressors = [acceleration, velocity * forward, forward, velocity * backward, -backward]
        else:
            regressors = [acceleration, velocity, np.sign(velocity), np.ones_like(velocity)]
        table = np.column_stack((*regressors, force))[self.transient_samples :]
        n, r = len(table), self.decimation
        if n < 4 * r:
            raise RecordError(f"{n} samples are too few for a decimation by {r}; at least {4 * r} are needed.")
        rows = np.arange(n)
        if r > 1:
            sharp = signal.cheby1(CHEBYSHEV_ORDER, CHEBYSHEV_RIPPLE_DB, CHEBYSHEV_EDGE / r, output="sos")
            first = r - (r * -(-n // r) - n) - 1
            table = signal.sosfiltfilt(sharp, table, axis=0, padtype="odd", padlen=3 * CHEBYSHEV_ORDER)
            table, rows = table[first::r], rows[first::r]
        return table[:, :-1], table[:, -1], rows + self.transient_samples


DIRECTIONAL = "directional_inverse_dynamics"
NAMES_OF: Mapping[str, tuple[str, ...]] = {
    "inverse_dynamics": ("mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N", "offset_N"),
    DIRECTIONAL: (
        "mass_kg",
        "viscous_friction_positive_N_s_per_m",
        "coulomb_friction_positive_N",
        "viscous_friction_negative_N_s_per_m",
        "coulomb_friction_negative_N",
    ),
}


class RigidDrive(Protocol):
    """What inverse dynamics ask of a drive: mass, friction and the force behind a record."""

    @property
    def mass_kg(self) -> float:
        """Total moved mass."""
        ...

    @property
    def friction_line(self) -> FrictionLine:
        """Nominal friction, at speed."""
        ...

    def motor_force(self, record: Record) -> FloatArray:
        """Return the motor's force in table coordinates (n_samples,)."""
        ...

    def respond(self, command: Record) -> Record:
        """Return what the nominal axis would log of a commanded motion, without noise."""
        ...


@final
@dataclass(frozen=True, kw_only=True)
class InverseDynamicsModel(LinearModel):
    """The motor force on accelerations, velocities and directions; ``name`` is one of `NAMES_OF`."""

    drive: RigidDrive
    protocol: InverseDynamics
    name: str

    @property
    def directional(self) -> bool:
        """Whether the friction differs from direction to direction."""
        return self.name == DIRECTIONAL

    def regression(self, record: Record) -> Regression:
        """Return the filtered force on the filtered regressors."""
        position, force = record["motor_position_m"], self.drive.motor_force(record)
        Z, y, rows = self.protocol.columns(position, force, record.sampling_time_s, self.directional)
        return Regression(
            regressors=Z,
            target=y,
            names=NAMES_OF[self.name],
            target_name="motor_force_N",
            time_s=record["time_s"][rows],
            rows=rows,
            disturbance_gain=1.0,
        )

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return mass and nominal friction; effects enter by the straight line of their curve at speed."""
        line = self.drive.friction_line
        viscous, coulomb, offset = line.viscous_N_s_per_m, line.coulomb_N, line.offset_N
        each = (
            (viscous, coulomb + offset, viscous, coulomb - offset) if self.directional else (viscous, coulomb, offset)
        )
        return dict(zip(NAMES_OF[self.name], (self.drive.mass_kg, *each), strict=True))

    def free_run(self, command: Record, parameters: Mapping[str, float]) -> FloatArray:
        """Return the force for the motion that the nominal axis makes of a command."""
        moved = self.regression(self.drive.respond(command))
        return np.asarray(moved.regressors @ np.array([parameters[name] for name in moved.names]))
