"""What servo stages share: a linear response to the commanded position, and their linear model."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import SpecError
from fdbench.plants._linear_system import LinearSystem, continuous
from fdbench.plants._plant import LinearModel, Plant
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.simulate.stage import Response, StageSystem
from fdbench.simulate.system import FloatArray, Setup, check_table_forces
from fdbench.specification import positive


@dataclass(frozen=True, kw_only=True)
class StagePlant(Plant):
    r"""Servo-controlled axes, each known as a linear response to its commanded position.

    The model ``servo_response`` is :math:`y = \gamma\, x_{pb} + \varepsilon`: y the measured position, :math:`x_{pb}`
    the position that the nominal plant predicts from the command alone, and a gain for each axis that is nominally 1.
    The rows of a second axis follow those of the first, with a column of their own.

    Parameters
    ----------
    travel_m, velocity_limit_m_per_s : float
        Limits of the table; an episode beyond them has diverged.
    """

    travel_m: float = positive()
    velocity_limit_m_per_s: float = positive()

    @abstractmethod
    def axes(self) -> Mapping[str, Response]:
        """Return the response of each axis by the prefix of its columns."""

    @property
    def table_limits(self) -> tuple[float, float]:
        """Travel (m) and velocity (m/s) of the table."""
        return self.travel_m, self.velocity_limit_m_per_s

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the response of each axis to its commanded position; see `LinearisedPlant`."""
        axes = self.axes()
        n = 0
        size = sum(len(axis.B) for axis in axes.values())
        A, B, C = np.zeros((size, size)), np.zeros((size, len(axes))), np.zeros((len(axes), size))
        for number, axis in enumerate(axes.values()):
            own = slice(n, n + len(axis.B))
            A[own, own], B[own, number], C[number, own] = axis.A, axis.B, axis.C
            n = own.stop
        commands, readings = ([f"{prefix}{name}" for prefix in axes] for name in ("reference_position_m", "position_m"))
        return continuous(A, B, C, commands, readings, sampling_time_s)

    def linear_models(self) -> tuple["ServoResponse"]:
        """Return the one model, ``servo_response``."""
        return (ServoResponse(stage=self),)

    def nominal_response(self, record: Record) -> FloatArray:
        """Return the positions predicted from the commanded ones (n_rows,), axis after axis."""
        commands = [
            record[prefix + name] if name else np.zeros(record.n_samples)
            for prefix in self.axes()
            for name in ("reference_position_m", "reference_velocity_m_per_s", "")
        ]
        period_s, silent = record.sampling_time_s, np.zeros(len(self.axes()))
        system = StageSystem(self.axes(), self.table_limits, np.column_stack(commands), period_s, 1, silent)
        system.start([0])
        predicted: FloatArray = system.advance(system.n_samples)[:, 2 : 3 * len(self.axes()) : 3, 0].T.ravel()
        return predicted

    def system(self, setup: Setup, n_lanes: int = 1) -> StageSystem:
        """Return the stage with the setup's effects as forces on its table."""
        axes = self.axes()
        check_table_forces(setup.unmodelled, "a servo stage", states=True)
        reference = setup.reference()
        if reference.shape[1] != 3 * len(axes):
            raise SpecError(f"motion: it moves {reference.shape[1] // 3} axes, the plant has {len(axes)}.")
        readings = [f"{prefix or 'table_'}position_m" for prefix in axes]
        setup.noise.check_only(readings, self.name)
        deviations = np.array([getattr(setup.noise, reading) for reading in readings])
        period_s, substeps = setup.timing.sampling_time_s, setup.timing.substeps
        forces, limits = setup.unmodelled, self.table_limits
        return StageSystem(axes, limits, reference, period_s, substeps, deviations, forces, n_lanes, setup.start)


@final
@dataclass(frozen=True, kw_only=True)
class ServoResponse(LinearModel):
    """The model ``servo_response`` of a stage; see `StagePlant`."""

    stage: StagePlant
    name: str = "servo_response"

    def regression(self, record: Record) -> Regression:
        """Return the measured positions on the predicted ones, axis after axis."""
        axes = self.stage.axes()
        return Regression(
            regressors=np.kron(np.eye(len(axes)), np.ones((record.n_samples, 1)))
            * self.stage.nominal_response(record)[:, None],
            target=np.concatenate([record[f"{prefix}position_m"] for prefix in axes]),
            names=tuple(self.nominal_parameters(record.sampling_time_s)),
            target_name="position_m",
            time_s=np.tile(record["time_s"], len(axes)),
            rows=np.tile(np.arange(record.n_samples), len(axes)),
            disturbance_gain=float(np.mean([response.compliance_m_per_N for response in axes.values()])),
        )

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return the gain of each axis, nominally 1."""
        return {f"{prefix}response_gain": 1.0 for prefix in self.stage.axes()}

    def free_run(self, command: Record, parameters: Mapping[str, float]) -> FloatArray:
        """Return the positions that the nominal response makes of a command, times the gain of each axis."""
        gains = [parameters[name] for name in self.nominal_parameters(command.sampling_time_s)]
        return np.repeat(gains, command.n_samples) * self.stage.nominal_response(command)
