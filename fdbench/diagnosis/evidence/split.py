"""Runs split into what is fitted and what is judged on, with their noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.records.noise_model import NoiseModel
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Split:
    """Runs, and which samples of each are judged on instead of fitted."""

    runs: Sequence[RecordedRun]
    held_out: Sequence[NDArray[np.bool_]]
    noise_models: Mapping[str, NoiseModel]
    changes: Sequence[Change | None] = ()
    explained: Sequence[Mapping[str, FloatArray]] = ()

    @property
    def plain(self) -> "Split":
        """The split in which what changes from run to run is noise as any other: that gaps are reported in."""
        return Split(
            runs=self.runs,
            held_out=self.held_out,
            noise_models={name: floor.whole for name, floor in self.noise_models.items()},
        )

    @property
    def is_measured(self) -> bool:
        """Whether repeats tell the noise of every channel."""
        return all(floor.measured for floor in self.noise_models.values())

    @property
    def fitted(self) -> list[int]:
        """Places of the runs of which something is fitted."""
        return [place for place, out in enumerate(self.held_out) if not out.all()]

    @property
    def judged(self) -> list[int]:
        """Places of the runs of which something is judged on."""
        return [place for place, out in enumerate(self.held_out) if out.any()]

    def per_unit(self, place: int, name: str) -> float:
        """Return what one unit of a channel of a run is, in units of its mean's noise."""
        return float(np.sqrt(self.runs[place].repeats) / self.noise_models[name].rms)

    def scale(self, place: int, signals: Mapping[str, FloatArray]) -> None:
        """Bring signals (n_signals, n_samples) of each channel of a run into units of its mean's noise, in place.

        What changes from run to run is shrunk to the size of the noise.
        """
        for name, values in signals.items():
            values *= self.per_unit(place, name)
        if self.changes and (change := self.changes[place]) is not None:
            change.whiten(list(signals.values()))

    def gap(self, place: int, simulated: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return what a simulation leaves of each channel of a run, (n_samples,), in the same units."""
        left = {name: (measured - simulated[name])[None] for name, measured in self.runs[place].channels.items()}
        self.scale(place, left)
        return {name: values[0] for name, values in left.items()}
