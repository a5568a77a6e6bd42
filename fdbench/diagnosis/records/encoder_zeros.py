"""Zeros of two encoders: where each counts from says nothing of the machine."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.records.runs import DEFLECTION, RecordedRun, left_between_encoders
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.record import FloatArray
from fdbench.wording import si_text

ENDS = 0.02, 0.98  # quantiles between which the middle is


def with_common_zeros(
    runs: Sequence[RecordedRun], simulated: Sequence[Mapping[str, FloatArray]]
) -> tuple[list[RecordedRun], list[str]]:
    """Return runs whose encoders count from one place, as far as a model tells it, and what to say.

    What the zeros are apart is the middle of what the model leaves of their difference, as play has two sides: one
    number for all runs, as a wave of the screw begins elsewhere in each. It is said where it is far more than the rest.

    Parameters
    ----------
    runs : sequence of RecordedRun
    simulated : sequence of mappings
        Channels of each run as a model has them.
    """
    left = left_between_encoders(runs, simulated)
    if left is None:
        return list(runs), []
    known = left[np.isfinite(left)]
    apart_m = float(np.mean(np.quantile(known, ENDS))) if len(known) else 0.0

    def moved(channels: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {**channels, DEFLECTION: channels[DEFLECTION] - apart_m}

    found = [
        dataclasses.replace(
            run, channels=moved(run.channels), readings=None if run.readings is None else moved(run.readings)
        )
        for run in runs
    ]
    if abs(apart_m) <= PLAUSIBLE.zeros_apart * float(np.std(left)):
        return found, []
    return found, [
        f"The positions of motor and table count from zeros that are {si_text(abs(apart_m), 'm')} apart, which is "
        "no cause of anything: it is taken out."
    ]
