"""Readings: what hypotheses read along runs, each simulated once; what is asked for again is kept and handed on."""

from collections.abc import Iterator, Mapping, Sequence
from weakref import WeakValueDictionary

import numpy as np

from fdbench.diagnosis.model.hypothesis import Hypothesis, Key
from fdbench.diagnosis.model.kept_responses import KeptResponses
from fdbench.diagnosis.model.replay import Replay, Replayed, rooms
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.settings import MODEL
from fdbench.record import FloatArray

Channels = Mapping[str, FloatArray]


class Readings:
    """Readings of hypotheses about one nominal model along some runs, by one simulator at its substeps.

    Parameters
    ----------
    replay : Replay
    runs : sequence of RecordedRun
    beyond : sequence of mappings, optional
        Of each run, what is added to each channel as it is simulated: see `coarsened`.
    finer : Readings, optional
        Those of more substeps that these stand for.

    Attributes
    ----------
    responses : list of KeptResponses
        Of each run.
    """

    def __init__(
        self,
        replay: Replay,
        runs: Sequence[RecordedRun],
        beyond: Sequence[Channels] = (),
        finer: "Readings | None" = None,
    ) -> None:
        self.replay = replay
        self.runs = runs
        self.beyond = beyond
        self.finer = finer
        self.responses = [KeptResponses() for _ in runs]
        self._kept: dict[Key, dict[int, Channels]] = {}
        # What is coarser holds what is finer, which holds it no longer than others do.
        self._coarser: WeakValueDictionary[tuple[int, Key], Readings] = WeakValueDictionary()
        self._moved: dict[tuple[int, Key], list[dict[str, FloatArray]]] = {}
        self._rough: tuple[Key, Readings] | None = None

    def of(
        self, place: int, hypotheses: Sequence[Hypothesis], keep: Sequence[Hypothesis] = ()
    ) -> dict[str, FloatArray]:
        """Return each channel of a run as hypotheses read it, (n_hypotheses, n_samples), in arrays of the caller's own.

        Those to ``keep`` are not simulated again until they are forgotten.
        """
        return next(self.each({place: hypotheses}, keep))

    def each(
        self, asked: Mapping[int, Sequence[Hypothesis]], keep: Sequence[Hypothesis] = (), *, lent: bool = False
    ) -> Iterator[dict[str, FloatArray]]:
        """Yield for one run after the other what `of` returns; several are simulated at once where they are small.

        ``asked`` are the hypotheses of each run, by its place. Arrays that are ``lent`` hold readings of a run until
        the next one is asked for, here or elsewhere.
        """
        kept = {item.key for item in keep}
        for together in self._together(asked):
            runs, numbers = [self.runs[place] for place in together], [len(asked[place]) for place in together]
            found = self.replay.memory.rooms(runs, numbers) if lent else rooms(runs, numbers)
            replayed, every = [], [[item.key for item in asked[place]] for place in together]
            firsts = [{key: own for own, key in reversed([*enumerate(keys)])} for keys in every]
            for place, run, channels, first in zip(together, runs, found, firsts, strict=True):
                new = [own for key, own in first.items() if place not in self._kept.get(key, ())]
                variants = [asked[place][own].variant for own in new]
                replayed.append(Replayed(run=run, variants=variants, channels=channels, places=new))
            self.replay.fill(replayed)
            for place, item in zip(together, replayed, strict=True):
                self._add_what_is_beyond(place, item)
            for place, channels, keys, first in zip(together, found, every, firsts, strict=True):
                for own, key in enumerate(keys):
                    known = self._kept.get(key, {})
                    for name, values in channels.items():
                        if place in known:
                            values[own] = known[place][name]
                        elif first[key] != own:
                            values[own] = values[first[key]]
                for key in kept & first.keys():
                    if place not in self._kept.get(key, ()):
                        copies = {name: values[first[key]].copy() for name, values in channels.items()}
                        self._kept.setdefault(key, {})[place] = copies
                yield channels

    def _add_what_is_beyond(self, place: int, simulated: Replayed) -> None:
        if self.beyond:
            for name, values in simulated.channels.items():
                for own in simulated.places:
                    values[own] += self.beyond[place][name]

    def up_to(self, runs: Sequence[RecordedRun]) -> "Readings":
        """Return readings of the same substeps along runs that are the first samples of these."""
        beyond = [
            {name: values[: run.n_samples] for name, values in own.items()}
            for own, run in zip(self.beyond, runs, strict=False)
        ]
        return Readings(self.replay, runs, beyond)

    def _together(self, asked: Mapping[int, Sequence[Hypothesis]]) -> list[list[int]]:
        """Return the places in groups whose readings are held at once."""
        groups: list[list[int]] = []
        size = 0
        for place, hypotheses in asked.items():
            own = len(hypotheses) * self.runs[place].n_samples
            if not groups or size + own > MODEL.held_at_once:
                groups.append([])
                size = 0
            groups[-1].append(place)
            size += own
        return groups

    def alone(self, place: int, hypothesis: Hypothesis) -> Channels:
        """Return each channel of a run as one hypothesis reads it, (n_samples,), and keep that of all runs."""
        known = self._kept.get(hypothesis.key, {})
        if place not in known:
            others = [other for other in range(len(self.runs)) if other not in known]
            for _ in self.each({other: [hypothesis] for other in others}, keep=[hypothesis]):
                pass
        return self._kept[hypothesis.key][place]

    def forget(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Keep hypotheses no longer, nor their responses."""
        keys = {hypothesis.key for hypothesis in hypotheses}
        for key in keys:
            self._kept.pop(key, None)
        for responses in self.responses:
            responses.forget(keys)

    def coarsened(self, nominal: Hypothesis, noise_models: Mapping[str, NoiseModel]) -> "Readings":
        """Return those with the fewest substeps that move no reading by a fifth of the noise within a run.

        What they move the nominal model's readings by is taken from those of all hypotheses: of one that is near, it is
        nearly the same.
        """
        return self._fewest(nominal, noise_models)

    def about(self, hypothesis: Hypothesis, noise_models: Mapping[str, NoiseModel]) -> "Readings":
        """Return those that are right for a hypothesis, too, where these are off by a fifth of the noise.

        Forces that come at once, such as that of a tooth that enters, are integrated worse than the nominal model.
        """
        if self.finer is None:
            return self
        is_right = self._are_small(self.finer._less(self, hypothesis), noise_models)
        found = self if is_right else self.finer._fewest(hypothesis, noise_models)
        self.finer.forget([hypothesis])
        return found

    def roughly(self, hypothesis: Hypothesis) -> "Readings":
        """Return those with one substep, moved by what that moves the readings of a hypothesis by; kept are the last.

        Of what is near the hypothesis they tell the response, whatever the substeps; they share kept responses.
        """
        if self.replay.substeps == 1:
            return self
        if self._rough is None or self._rough[0] != hypothesis.key:
            replay = self.replay.with_substeps(1)
            rough = Readings(replay, self.runs, self._less(Readings(replay, self.runs), hypothesis))
            rough.responses = self.responses
            rough._kept[hypothesis.key] = self._kept[hypothesis.key]
            self._rough = hypothesis.key, rough
        return self._rough[1]

    def _fewest(self, hypothesis: Hypothesis, noise_models: Mapping[str, NoiseModel]) -> "Readings":
        """Return those with the fewest substeps that move no reading by much, and keep by how much what is tried."""
        for substeps in MODEL.coarser_substeps:
            if substeps >= self.replay.substeps:
                break
            place = substeps, hypothesis.key
            found = self._coarser.get(place)
            if found is None:
                replay = self.replay.with_substeps(substeps)
                if place not in self._moved:
                    self._moved[place] = self._less(Readings(replay, self.runs), hypothesis)
                found = self._coarser[place] = Readings(replay, self.runs, self._moved[place], self)
            if self._are_small(found.beyond, noise_models):
                return found
        return self

    def _less(self, other: "Readings", hypothesis: Hypothesis) -> list[dict[str, FloatArray]]:
        """Return, of each run, what a hypothesis reads here less what it reads by others."""
        both = [(self.alone(place, hypothesis), other.alone(place, hypothesis)) for place in range(len(self.runs))]
        return [{name: own[name] - others[name] for name in own} for own, others in both]

    def _are_small(self, errors: Sequence[Channels], noise_models: Mapping[str, NoiseModel]) -> bool:
        """Return whether errors of all runs are within what few substeps may move readings by."""
        n_samples = sum(run.n_samples for run in self.runs)
        return all(
            sum(float(np.sum(own[name] ** 2)) for own in errors) <= n_samples * (MODEL.substeps_error * item.rms) ** 2
            for name, item in noise_models.items()
        )
