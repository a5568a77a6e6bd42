"""Readings: what hypotheses read along runs, each simulated once; what is asked for again is kept and handed on."""

from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect
from fdbench.record import FloatArray

Channels = Mapping[str, FloatArray]
Key = tuple[tuple[float, ...], tuple[Effect, ...], tuple[int, ...]]


def _key(hypothesis: Hypothesis) -> Key:
    """Return what tells hypotheses about one nominal model apart."""
    return hypothesis.shifts, hypothesis.effects, hypothesis.replaced


class Readings:
    """Readings of hypotheses about one nominal model along some runs, by one simulator at its substeps.

    Parameters
    ----------
    replay : Replay
    runs : sequence of RecordedRun
    """

    def __init__(self, replay: Replay, runs: Sequence[RecordedRun]) -> None:
        self.replay = replay
        self.runs = runs
        self._kept: dict[Key, dict[int, Channels]] = {}
        self._coarser: dict[int, Readings] = {}

    def of(
        self, place: int, hypotheses: Sequence[Hypothesis], keep: Sequence[Hypothesis] = ()
    ) -> dict[str, FloatArray]:
        """Return each channel of a run as hypotheses read it, (n_hypotheses, n_samples), in arrays of the caller's own.

        Those to ``keep`` are not simulated again until they are forgotten.
        """
        run, keys = self.runs[place], [_key(item) for item in hypotheses]
        new: dict[Key, int] = {}
        variants: list[Variant] = []
        for key, item in zip(keys, hypotheses, strict=True):
            if key not in new and place not in self._kept.get(key, ()):
                new[key] = len(variants)
                variants.append(item.variant)
        found = self.replay.simulate(run, variants) if variants else {}
        kept = {key: self._kept[key][place] for key in keys if key not in new}
        for key in map(_key, keep):
            if key in new:
                own = {name: values[new[key]].copy() for name, values in found.items()}
                self._kept.setdefault(key, {})[place] = own
        if len(new) == len(keys):
            return found
        return {
            name: np.stack([found[name][new[key]] if key in new else kept[key][name] for key in keys])
            for name in run.channels
        }

    def alone(self, place: int, hypothesis: Hypothesis) -> Channels:
        """Return each channel of a run as one hypothesis reads it, (n_samples,), and keep it."""
        if place not in self._kept.get(_key(hypothesis), ()):
            self.of(place, [hypothesis], keep=[hypothesis])
        return self._kept[_key(hypothesis)][place]

    def forget(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Keep hypotheses no longer."""
        for key in map(_key, hypotheses):
            self._kept.pop(key, None)

    def coarsened(self, nominal: Hypothesis, noise_models: Mapping[str, NoiseModel]) -> "Readings":
        """Return those with the fewest substeps that move no reading by a tenth of the noise within a run."""
        places = range(len(self.runs))
        n_samples = sum(run.n_samples for run in self.runs)
        for substeps in MODEL.coarser_substeps:
            if substeps >= self.replay.substeps:
                break
            coarse = self._coarser.setdefault(substeps, Readings(self.replay.with_substeps(substeps), self.runs))
            both = [(self.alone(place, nominal), coarse.alone(place, nominal)) for place in places]
            moved = {name: sum(float(np.sum((a[name] - b[name]) ** 2)) for a, b in both) for name in noise_models}
            allowed = {name: n_samples * (MODEL.substeps_error * item.rms) ** 2 for name, item in noise_models.items()}
            if all(moved[name] <= allowed[name] for name in noise_models):
                return coarse
        return self
