"""The oracle of a case: what would be left of the held-out gap if a diagnosis said the exact truth.

The oracle is the machine that recorded the case with the injected effects that may be named, at their true parameters,
and with the true values of the nominal parameters. What no diagnosis can say is left out: noise of sensors and process,
friction that differs from run to run, background effects, and injected effects that the library lacks. What a second
implementation has anyhow (its formulae, the latency) stays, so there the oracle is beyond the reach of the library.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fdbench.diagnosis.evidence.prepare import merged_runs
from fdbench.diagnosis.judge.reduction import channel_gaps, explained_fraction
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.runs import prepare
from fdbench.record import FloatArray, Record

Gaps = Mapping[str, Mapping[str, float]]
"""Of each channel ``noise_floor``, ``on_paper`` and ``oracle``: root mean squares in its unit."""


def held_out_gaps(
    nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record], oracle: Callable[[FloatArray], Record]
) -> Gaps:
    """Return the noise of repeats, and what the nominal model and the oracle leave of what is held out.

    Channels, floor and held-out samples are those of a diagnosis: without hold-outs, the last repeats.

    Parameters
    ----------
    nominal : Nominal
    records, holdouts : sequences of Record
    oracle : callable
        Returns the record of a command (n_samples, 3), without noise.
    """
    readings, split = merged_runs(nominal, records, holdouts)
    as_nominal = channel_gaps(readings, split, [start(nominal)])[0]
    missed: dict[str, list[FloatArray]] = {name: [] for name in split.noise_models}
    for run, out in zip(split.runs, split.held_out, strict=True):
        if out.any():
            said = prepare(oracle(run.reference), nominal.drive).channels
            for name, measured in run.channels.items():
                missed[name].append((measured - said[name])[out])
    return {
        name: {
            "noise_floor": float(floor.rms),
            "on_paper": float(floor.rms) * math.sqrt(gap),
            "oracle": math.sqrt(float(np.mean(np.concatenate(missed[name]) ** 2))),
        }
        for (name, floor), gap in zip(split.noise_models.items(), as_nominal.tolist(), strict=True)
    }


def oracle_closure(truth: Mapping[str, Any]) -> float | None:
    """Return the share of the held-out excess over the floor that the oracle closes.

    Mean over the channels of squares in units of the floor, as in the closure of an answer. None where the nominal gap
    is too small, or the truth is of a key that has no oracle.

    >>> oracle_closure({"held_out": {"motor_force_N": {"noise_floor": 2.0, "on_paper": 22.0, "oracle": 4.0}}})
    0.975
    """
    if "held_out" not in truth:
        return None
    gaps: Gaps = truth["held_out"]
    before, after = (
        float(np.mean([(own[name] / own["noise_floor"]) ** 2 for own in gaps.values()]))
        for name in ("on_paper", "oracle")
    )
    return explained_fraction(before, after)
