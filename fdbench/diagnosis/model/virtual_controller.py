r"""Diagnosis without the controller: the model follows the measured motion under a virtual controller of our own.

The virtual controller is a proportional cascade, :math:`F = K_v [v_r - v + K_x (x_r - x)]`. Its command is made such
that along the measured motion it gives the measured force, sample by sample:

.. math:: x_r = x + (F / K_v + v - v_r) / K_x

So the record is one of a known loop, and is simulated as any other. A model that is complete moves as measured and
needs no other force. Of one that lacks a force d, force and position differ by T d and S P d, with the complementary
sensitivity T = 1 - S of the loop and the plant P: what lies above the bandwidth is no gap.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.low_pass import low_passed
from fdbench.diagnosis.records.plausibility import check_content, check_sizes, noise_estimate
from fdbench.diagnosis.records.runs import (
    COMMAND,
    SIDES,
    RecordedRun,
    channels_of,
    lap_length,
    position_column,
    prepare,
)
from fdbench.diagnosis.settings import MODEL, RECORDS
from fdbench.errors import RecordError, SpecError
from fdbench.plants.feed_drive import FeedDrive, Following
from fdbench.record import FloatArray, Record, held_samples
from fdbench.simulate.stability import is_stable

FREQUENCIES = 400


def prepared(
    nominal: Nominal, records: Sequence[Record], *, on_paper: bool = True
) -> tuple[Nominal, list[RecordedRun], list[str]]:
    """Return the runs of records, the model to simulate them with, and warnings in words.

    Where the model has a controller and every record its command, the model stays as it is. Else the controller becomes
    a virtual one, and the runs follow the measured motion. A loop that is not ``on_paper`` but was fitted to records
    is no mistake at the edge of its stability.

    Raises
    ------
    RecordError
        If a record lacks the force or the position, has impossible values, or none of them shows a motion.
    SpecError
        If the loop of the model is unstable, or no virtual controller holds it.
    """
    for item in records:
        check_sizes(item)
    drive = nominal.drive
    known = not isinstance(drive.controller, Following)
    silent = [item.source for item in records if COMMAND not in item]
    if known and not silent:
        if on_paper:
            drive.check_loop(records[0].sampling_time_s / nominal.simulation.cycles)
        rates = nominal.simulation.command_rates or "central"
        runs = [prepare(item, drive, rates, nominal.simulation.cycles) for item in records]
        check_content(runs)
        return nominal, runs, []
    controller = virtual_controller(drive, records)
    drive = dataclasses.replace(drive, controller=controller)
    runs = [follow(item, drive, nominal.simulation.cycles) for item in records]
    check_content([run.as_read() for run in runs])
    why = f"{silent[0]}: no column {COMMAND}" if known else "The model has no controller"
    warning = (
        f"{why}: the model was made to follow the measured motion by a virtual controller of "
        f"{controller.bandwidth_Hz:.3g} Hz, and the force that it needs compared with the measured one; the gap of "
        "position_m is that of this loop. What the real controller does by itself (its delay, filters, limits) cannot "
        "be seen, errors of the encoder only by the force that they cost, and little of what lies far above "
        f"{controller.bandwidth_Hz:.3g} Hz."
    )
    return dataclasses.replace(nominal, plant=drive), runs, [warning, *_lowered(nominal.drive, controller)]


def _lowered(asked: FeedDrive, found: Following) -> list[str]:
    """Return in words that a bandwidth that was asked for is not kept."""
    given = asked.controller
    if not isinstance(given, Following) or given.bandwidth_Hz in (found.bandwidth_Hz, Following().bandwidth_Hz):
        return []
    return [
        f"The virtual controller was asked for {given.bandwidth_Hz:.3g} Hz and has {found.bandwidth_Hz:.3g} Hz: "
        "faster, it would ring at this sampling time, or turn the noise of the position into a loud force."
    ]


def virtual_controller(drive: FeedDrive, records: Sequence[Record]) -> Following:
    """Return the fastest virtual controller, at most as fast as asked for, that neither rings nor is loud.

    It must hold the nominal model (`holds`), and its reaction to the noise of the position must be small.
    """
    controller = drive.controller if isinstance(drive.controller, Following) else Following()
    side = _side(drive, records[0])
    period = records[0].sampling_time_s
    forces = [drive.motor_force(item) for item in records]
    controller = dataclasses.replace(
        controller,
        mass_kg=drive.mass_kg,
        smoothed_Hz=None,
        feedback=side,
        greatest_force_N=max(float(np.abs(force).max()) for force in forces) or None,
    )
    noise_m = max(noise_estimate(item[_column(item, drive, controller)]) for item in records)
    quiet_N = max(max(noise_estimate(force), MODEL.reaction * float(np.std(force))) for force in forces)
    while not holds(drive, controller, period):
        controller = _slower(controller)
        if controller.bandwidth_Hz < MODEL.lowest_Hz:
            raise SpecError(
                f"plant: no virtual controller holds this axis at one sample each {period:.4g} s. Check that time_s is "
                "in seconds, masses and stiffness, or give the real controller as [plant.controller]."
            )
    if noise_gain(controller, period) * noise_m > quiet_N:
        controller = _smoothing(controller)
    while noise_gain(controller, period) * noise_m > quiet_N and controller.bandwidth_Hz > MODEL.quietest_Hz:
        controller = _smoothing(_slower(controller))
    return controller


def _slower(controller: Following) -> Following:
    return dataclasses.replace(controller, bandwidth_Hz=MODEL.slower * controller.bandwidth_Hz)


def _smoothing(controller: Following) -> Following:
    """Return the controller behind a filter without phase, which keeps what its loop passes on."""
    return dataclasses.replace(controller, smoothed_Hz=MODEL.smoothed * controller.bandwidth_Hz)


def noise_gain(controller: Following, period_s: float) -> float:
    r"""Return the force per metre of white position noise, by the velocity that is differenced from it.

    A difference over s samples of h has :math:`\sqrt 2 / s h` of it, one behind a low-pass filter at f
    :math:`2 \pi \sqrt{2 h f^3 / 3}`.
    """
    rough = math.sqrt(2.0) / (controller.difference_span * period_s)
    if controller.smoothed_Hz is not None:
        rough = min(rough, 2.0 * math.pi * math.sqrt(2.0 * period_s * controller.smoothed_Hz**3 / 3.0))
    return controller.velocity_gain_N_s_per_m * rough


def _side(drive: FeedDrive, record: Record) -> str:
    """Return which side's position is followed: the motor's, where it was measured."""
    if drive.screw is None or SIDES[0] in record:
        return "motor"
    if SIDES[1] in record:
        return "table"
    if isinstance(drive.controller, Following) and drive.controller.feedback is None:
        raise RecordError(
            f"{record.source}: no column {SIDES[0]} or {SIDES[1]}. The model has a screw, so say on which side "
            "of it the position was measured: map the column to one of these names."
        )
    return "table" if drive.controller.uses_table else "motor"


def _column(record: Record, drive: FeedDrive, controller: Following) -> str:
    own = SIDES[controller.uses_table]
    return own if own in record else position_column(record, drive)


def holds(drive: FeedDrive, controller: Following, period_s: float) -> bool:
    """Return whether the sampled loop of the linear part is stable and its complementary sensitivity has a low peak."""
    flow = drive.mechanics().propagators(period_s).reshape(4, 6)
    # Motor and table of a rigid axis are one: its second pair of states repeats the first.
    n = 2 if drive.screw is None else 4
    closed, b, gain = np.zeros((n + 2, n + 2)), np.zeros(n + 2), np.zeros(n + 2)
    own = 2 if controller.uses_table and n == 4 else 0
    closed[:n, :n], b[:n] = flow[:n, :n], flow[:n, 4]
    closed[n, own] = closed[n + 1, n] = 1.0  # the readings one and two samples ago
    rate = 1.0 / (controller.difference_span * period_s)
    gain[own], gain[n + controller.difference_span - 1] = controller.position_gain_per_s + rate, -rate
    gain *= controller.velocity_gain_N_s_per_m
    closed -= np.outer(b, gain)
    if not is_stable(closed):
        return False
    z = np.exp(1j * np.pi * np.geomspace(1e-3, 1.0, FREQUENCIES))
    states = np.linalg.solve(z[:, None, None] * np.eye(n + 2) - closed, np.tile(b[:, None], (FREQUENCIES, 1, 1)))
    return bool(np.abs(states[:, :, 0] @ gain).max() < MODEL.highest_peak)


def follow(record: Record, drive: FeedDrive, cycles: int) -> RecordedRun:
    """Return the run of a record whose command is made from its measured motion and force.

    Parameters
    ----------
    record : Record
    drive : FeedDrive
        With its virtual controller.
    cycles : int
        Of the real controller between two samples, over which it changes its force.
    """
    controller, period = drive.controller, record.sampling_time_s
    if not isinstance(controller, Following):
        raise SpecError("plant.controller: a motion is followed with a controller of kind following.")
    readings = channels_of(record, drive, _column(record, drive, controller))
    logged_force = readings["motor_force_N"]
    readings["motor_force_N"] = acting(logged_force, cycles)
    held = held_samples(record)
    channels = {
        name: _smoothed_as(_interpolated(values, held), controller, period) for name, values in readings.items()
    }
    position, force = channels["position_m"], channels["motor_force_N"]
    if controller.smoothed_Hz is None:
        channels = readings
    motion = smoothed(position, period, controller.bandwidth_Hz)
    run = RecordedRun(
        name=record.source,
        period_s=period,
        reference=motion,
        channels=channels,
        lap=None,
        held=held,
        condition=record.provenance.get("condition"),
        readings=None if controller.smoothed_Hz is None else readings,
    )
    start, slope = run.start
    span = controller.difference_span
    back = np.concatenate((start - slope * period * np.arange(span, 0, -1), position[:-span]))
    velocity = (position - back) / (span * period)
    reference = motion.copy()
    lead = force / controller.velocity_gain_N_s_per_m + velocity - motion[:, 1]
    reference[:, 0] = position + lead / controller.position_gain_per_s
    command = record.get(COMMAND)
    own, same = (motion[:, 0], RECORDS.same_motion) if command is None else (command, RECORDS.same_command)
    return dataclasses.replace(
        run,
        reference=reference,
        lap=lap_length(own, period, same),
        motion=(own, same),
        given_force=logged_force if command is None else None,
    )


def acting(force: FloatArray, cycles: int) -> FloatArray:
    r"""Return the mean force over each sampling time, of forces that change in several cycles from sample to sample.

    .. math:: \bar F_k = (1 - a) F_k + a F_{k + 1}, \qquad a = \tfrac12 (1 - 1 / n)

    with n cycles, the force on a straight line from one sample to the next; after the last one it stays.

    >>> acting(np.array([0.0, 8.0, 8.0]), 4).tolist()
    [3.0, 8.0, 8.0]
    """
    share = 0.5 * (1.0 - 1.0 / cycles)
    return (1.0 - share) * force + share * np.append(force[1:], force[-1:])


def _interpolated(values: FloatArray, held: NDArray[np.bool_]) -> FloatArray:
    """Return the values with held samples interpolated."""
    time = np.arange(len(values))
    return np.interp(time, time[~held], values[~held])


def _smoothed_as(values: FloatArray, controller: Following, period_s: float) -> FloatArray:
    """Return values without what lies above the smoothing of a controller, and without a delay."""
    if controller.smoothed_Hz is None or 2.0 * controller.smoothed_Hz * period_s >= MODEL.highest_of_nyquist:
        return values
    return low_passed(values, controller.smoothed_Hz, period_s)


def smoothed(position: FloatArray, period_s: float, bandwidth_Hz: float) -> FloatArray:
    """Return position, velocity and acceleration by cubics over a sliding window (Savitzky and Golay 1964), (n, 3).

    A window of 2 h + 1 samples keeps what is below 0.62 / h of the sampling frequency.
    """
    from scipy.signal import savgol_filter

    half = max(2, round(0.62 / (MODEL.smoothed * bandwidth_Hz * period_s)))
    width = min(2 * half + 1, (len(position) - 1) // 2 * 2 + 1)
    orders = range(3)
    return np.column_stack([savgol_filter(position, width, min(3, width - 1), order, period_s) for order in orders])
