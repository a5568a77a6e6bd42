"""Names the effect whose simulated change of the motor force is correlated most with the gap in the motor force."""

from collections.abc import Sequence
from typing import final

import numpy as np

from fdbench.diagnosis.evidence.prepare import merged_runs
from fdbench.diagnosis.model.candidates import candidates
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.search.periods import located
from fdbench.record import Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.trials.diagnosers._common import gap_probability

CHANNEL = "motor_force_N"


@final
class LargestCorrelation(Diagnoser):
    """Squared correlation of each effect alone, nothing re-calibrated, as its probability."""

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        readings, split = merged_runs(nominal, records, holdouts)
        base = start(nominal)
        every = candidates(base, located(readings, split, base), split.runs[0].period_s)
        lanes = [base, *(hypothesis for item in every for hypothesis in item.hypotheses(base))]
        products = np.zeros((len(lanes), len(lanes)))
        count = 0
        for place in split.fitted:
            run = split.runs[place]
            simulated = readings.of(place, lanes)[CHANNEL]
            signals = simulated - simulated[0]
            signals[0] = run.channels[CHANNEL] - simulated[0]
            signals = np.where(np.isfinite(signals).all(axis=1, keepdims=True), signals, 0.0)
            signals -= signals.mean(axis=1, keepdims=True)
            signals *= np.sqrt(run.repeats) / split.noise_models[CHANNEL].rms
            products += signals @ signals.T
            count += run.n_samples
        chances: dict[str, float] = {}
        first = 1
        for item in every:
            own = list(range(first, first + len(item.members)))
            first += len(own)
            explained = _explained(products, own) / max(products[0, 0], 1e-12)
            chances[item.name] = max(chances.get(item.name, 0.0), min(max(explained, 0.0), 1.0))
        gap = gap_probability(products[0, 0] / max(count, 1))
        return CaseAnswer(
            effects={name: gap * chance for name, chance in chances.items()},
            unknown=gap * (1.0 - max(chances.values(), default=0.0)),
            none=1.0 - gap,
        )


def _explained(products: np.ndarray, own: list[int]) -> float:
    """Return the energy of column 0 that a least-squares fit of some columns explains."""
    normal = products[np.ix_(own, own)]
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    right = products[own, 0] / scale
    return float(right @ np.linalg.lstsq(normal / np.outer(scale, scale), right, rcond=1e-9)[0])
