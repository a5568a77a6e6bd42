"""The gap of each channel and its noise floor, in the units of the channels."""

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.answer.gap import ChannelGap, Gap, NoiseBand, NoiseFloor
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.judge.localise import bands_up_to
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.record import FloatArray
from fdbench.rotary import spoken_unit
from fdbench.units import unit_of


def gap_of(split: Split, simulated: Sequence[Sequence[Mapping[str, FloatArray]]]) -> Gap:
    """Return the held-out gap of each channel as root mean square.

    Parameters
    ----------
    split : Split
    simulated : sequence of three sequences of mappings
        Channels of each run as the nominal, the re-calibrated and the repaired model have them.
    """
    sums = {name: np.zeros(4) for name in split.runs[0].channels}
    for place, (run, out) in enumerate(zip(split.runs, split.held_out, strict=True)):
        for name, measured in run.channels.items():
            for index, of_model in enumerate(simulated):
                sums[name][index] += float(np.sum((measured - of_model[place][name])[out] ** 2))
            sums[name][3] += float(out.sum())
    result = {}
    for name, total in sums.items():
        before, recalibrated, repaired = np.sqrt(total[:3] / max(total[3], 1.0)).tolist()
        spread = math.sqrt(
            sum(float(np.sum((run.channels[name] - run.channels[name].mean()) ** 2)) for run in split.runs)
            / sum(run.n_samples for run in split.runs)
        )
        result[name] = ChannelGap(
            before=before,
            recalibrated=recalibrated,
            repaired=repaired,
            reduction=1.0 - (repaired / recalibrated) ** 2 if recalibrated > 0.0 else 0.0,
            noise_floor=split.noise_models[name].total,
            unit=spoken_unit(unit_of(name)),
            relative=before / spread if spread > 0.0 else 0.0,
        )
    return Gap(channels=result)


def noise_floor(floor: NoiseModel, unit: str, period_s: float) -> NoiseFloor:
    """Return the floor of a channel: what repeats differ by, its parts, and that of the noise in bands of frequency."""
    edges = bands_up_to(0.5 / period_s)
    parts = floor.shares([2.0 * period_s * edge for edge in edges]).tolist()
    return NoiseFloor(
        value=floor.total,
        unit=unit,
        measured_from_repeats=floor.measured,
        within_a_run=floor.rms,
        from_run_to_run=math.sqrt(max(floor.total**2 - floor.rms**2, 0.0)),
        frequency=tuple(
            NoiseBand(band_Hz=band, value=floor.rms * math.sqrt(part))
            for band, part in zip(itertools.pairwise(edges), parts, strict=True)
        ),
    )
