"""Spindle testbed: the force on a rotating tool holder is to be estimated from vibration of the housing."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import RecordError, SpecError
from fdbench.plants._plant import LinearModel, Plant
from fdbench.plants._spectra import Spectra
from fdbench.plants._spindle_testbed_machine import SpindleTestbedMachine
from fdbench.plants._spindle_testbed_plan import ForceLevels, RandomSegments, SpindleSpeeds
from fdbench.record import Record
from fdbench.regression import Regression
from fdbench.simulate.spectra import lines
from fdbench.simulate.system import Setup
from fdbench.simulate.testbed import Plan, SpindleTestbedSystem
from fdbench.specification import bounded, positive


class InverseFrequencyResponse(LinearModel):
    """The samples whose force is withheld, without regressors; see `SpindleTestbed`."""

    name = "inverse_frequency_response"

    def regression(self, record: Record) -> Regression:
        """Return the withheld samples, whose target reads 0."""
        rows = np.flatnonzero(record["training_sample"] == 0.0)
        return Regression(
            regressors=np.empty((len(rows), 0)),
            target=record["force_N"][rows],
            names=(),
            target_name="force_N",
            time_s=record["time_s"][rows],
            rows=rows,
            disturbance_gain=1.0,
        )


@final
@dataclass(frozen=True, kw_only=True)
class SpindleTestbed(Plant):
    r"""Magnets pull at a rotating tool holder; force and vibration are logged at many speeds and force levels.

    A record is the whole series of measurements on one clock: all force levels at each speed, each condition for
    ``segments_per_condition`` segments. Of each segment the logger keeps the lines up to ``bandwidth_Hz``, without the
    mean. Where ``training_sample`` is 0, ``force_N`` is withheld (it reads 0) and is what estimators are asked for.

    The one model, ``inverse_frequency_response``, is an unknown map from the spectrum of a segment's acceleration to
    that of its force; it has no parameters with a truth. Rows of its regression are the samples whose force is
    withheld, its target is what the record holds there, zeros, and ``Estimate.disturbance_N`` is the force. `spectra`
    is what estimators work on. ``machine`` is a stand-in for the measured testbed, not a part of the published method.

    Source: Qu and Vogl, Estimating dynamic cutting forces of machine tools from measured vibrations using sparse
    regression with nonlinear function basis, section 3; the equations of `SpindleTestbedMachine` are ours.

    Parameters
    ----------
    lowest_speed_rad_per_s, highest_speed_rad_per_s, n_speeds
        Evenly spaced speeds.
    lowest_force_N, highest_force_N, n_forces
        Evenly spaced force levels, the height of a pulse.
    segment_s, bandwidth_Hz : float
    segments_per_condition : int
    force_limit_N, acceleration_limit_m_per_s2 : float
        Ranges of the sensors.
    withheld : RandomSegments, ForceLevels or SpindleSpeeds
    machine : SpindleTestbedMachine
    """

    lowest_speed_rad_per_s: float = positive()
    highest_speed_rad_per_s: float = positive()
    n_speeds: int = bounded(2, 100000)
    lowest_force_N: float = positive()
    highest_force_N: float = positive()
    n_forces: int = bounded(2, 100000)
    segment_s: float = positive()
    segments_per_condition: int = bounded(1, 100000)
    bandwidth_Hz: float = positive()
    force_limit_N: float = positive()
    acceleration_limit_m_per_s2: float = positive()
    withheld: RandomSegments | ForceLevels | SpindleSpeeds
    machine: SpindleTestbedMachine

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (
            ("lowest_speed_rad_per_s", "highest_speed_rad_per_s"),
            ("lowest_force_N", "highest_force_N"),
            ("highest_force_N", "force_limit_N"),
        ):
            if not getattr(self, low) < getattr(self, high):
                raise SpecError(f"{high}: {getattr(self, high):g} is not above {low}, {getattr(self, low):g}.")

    def plan(self, sampling_time_s: float) -> Plan:
        """Return the plan of measurements on a clock.

        Raises
        ------
        SpecError
            If a segment is not a whole number of samples, or the bandwidth reaches half the sampling rate.
        """
        samples, n_lines = self.segment_s / sampling_time_s, round(self.bandwidth_Hz * self.segment_s)
        if abs(samples - round(samples)) > 1e-6 * samples:
            raise SpecError(f"segment_s: {self.segment_s:g} s are {samples:.6g} samples; a whole number is needed.")
        if not 0 < 2 * n_lines < round(samples):
            raise SpecError(
                f"bandwidth_Hz: {self.bandwidth_Hz:g} Hz; at least {1.0 / self.segment_s:g} Hz, the first line, and "
                f"less than {0.5 / sampling_time_s:g} Hz, half the sampling rate, is needed."
            )
        return Plan(
            np.linspace(self.lowest_speed_rad_per_s, self.highest_speed_rad_per_s, self.n_speeds),
            np.linspace(self.lowest_force_N, self.highest_force_N, self.n_forces),
            self.segments_per_condition,
            round(samples),
            n_lines,
        )

    def system(self, setup: Setup, n_lanes: int = 1) -> SpindleTestbedSystem:
        """Return the testbed; the episode must be the whole plan."""
        plan = self.plan(setup.timing.sampling_time_s)
        n_samples = int(np.prod(plan.shape)) * plan.samples_per_segment
        if setup.timing.n_samples != n_samples:
            raise SpecError(
                f"timing.duration_s: {setup.timing.duration_s:g} s; the plan of {self.n_speeds} speeds and "
                f"{self.n_forces} force levels lasts {n_samples * setup.timing.sampling_time_s:g} s."
            )
        setup.noise.check_only({"acceleration_m_per_s2", "force_N"}, "a spindle testbed")
        if setup.unmodelled:
            raise SpecError(f"reality.effects: {setup.unmodelled[0].name} acts on a feed drive; a testbed takes none.")
        limits = self.force_limit_N, self.acceleration_limit_m_per_s2
        return SpindleTestbedSystem(self.machine, plan, self.withheld.mask, limits, setup, n_lanes)

    def linear_models(self) -> tuple[InverseFrequencyResponse]:
        """Return the one model, ``inverse_frequency_response``."""
        return (InverseFrequencyResponse(),)

    def spectra(self, record: Record) -> Spectra:
        """Return the spectra of all segments of a record, which may be another than the plan's.

        Raises
        ------
        RecordError
            If the record ends within a segment, a segment is withheld in part, or all are for training or withheld.
        """
        plan = self.plan(record.sampling_time_s)
        length = plan.samples_per_segment
        if record.n_samples % length:
            raise RecordError(f"{record.source}: {record.n_samples} samples; a multiple of {length}, one segment.")
        flags = record["training_sample"].reshape(-1, length)
        training = flags[:, 0] == 1.0
        if not ((flags == 1.0) == training[:, None]).all() or not ((flags == 0.0) != training[:, None]).all():
            raise RecordError(
                f"{record.source}: training_sample must be 1, or 0, in all of a segment of {length} samples."
            )
        if training.all() or not training.any():
            raise RecordError(
                f"{record.source}: training_sample is {flags[0, 0]:g} everywhere; both 0 and 1 are needed."
            )
        return Spectra(
            features=lines(record["acceleration_m_per_s2"].reshape(-1, length), plan.n_lines),
            targets=lines(np.where(flags == 1.0, record["force_N"].reshape(-1, length), 0.0), plan.n_lines),
            training=training,
            samples_per_segment=length,
        )
