"""Sparse regression of the force residual: sequentially thresholded least squares (STLSQ) on bootstrap resamples."""

from collections.abc import Sequence
from typing import final

import numpy as np

from fdbench.diagnosis.evidence.prepare import merged_runs
from fdbench.diagnosis.model.candidates import Candidate, candidates
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.periods import located
from fdbench.record import FloatArray, Record
from fdbench.statistics import drawn_counts
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.trials.diagnosers._common import gap_probability
from fdbench.trials.diagnosers._force_residual import STRIDE, InverseMotion, visible

SEGMENT_S = 0.25
BEYOND_DOUBT = 2.5  # standard deviations by which a nominal parameter must be off


@final
class SparseRegression(Diagnoser):
    r"""Nominal force residual against what each effect would give along the measured motion.

    .. math::
        \xi \leftarrow \arg\min \|r - \Phi \xi\|^2 + \lambda \|\xi\|^2, \quad
        \xi_g \leftarrow 0 \text{ where } \|\Phi_g \xi_g\|^2 < \epsilon \|r\|^2

    until nothing more is dropped. The probability of an effect is the share of resamples that keep it. Effects that
    correct a nominal parameter are never dropped, and named where that value is off beyond its uncertainty.

    Source: Brunton, Proctor, Kutz (2016), PNAS 113(15), the algorithm; Fasel et al. (2022), Proc. Royal Society A 478,
    the ensemble.

    Parameters
    ----------
    threshold : float
        Smallest share of the residual's energy, epsilon.
    ridge : float
        Lambda, for columns of unit energy.
    resamples : int
    """

    def __init__(self, threshold: float = 0.04, ridge: float = 1e-4, resamples: int = 40) -> None:
        self.threshold = threshold
        self.ridge = ridge
        self.resamples = resamples

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        readings, split = merged_runs(nominal, records, holdouts)
        base = start(nominal)
        every = visible(candidates(base, located(readings, split, base), split.runs[0].period_s))
        runs = [run for run, out in zip(split.runs, split.held_out, strict=True) if not out.all()]
        sums = _products(runs, nominal, every)
        count = sum(run.n_samples for run in runs) / STRIDE
        noise = count * split.noise_models["motor_force_N"].rms ** 2 / min(run.repeats for run in runs)
        groups = _best_of_class(sums.sum(axis=0), every)
        kept: dict[str, list[float]] = {item.name: [] for item, _ in groups}
        limits = _limits(nominal)
        left = []
        for counts in drawn_counts(np.arange(len(sums)), self.resamples):
            total = np.tensordot(counts, sums, axes=1)
            chosen, xi, rest = self._stlsq(total, groups)
            left.append(rest)
            for item, columns in groups:
                off = abs(xi[columns[0]]) * abs(float(getattr(item.members[0], item.kind.amplitude)))
                is_value = bool(item.kind.calibrates)
                named = off > BEYOND_DOUBT * limits.get(item.kind.calibrates, np.inf) if is_value else item in chosen
                kept[item.name].append(float(named))
        gap = gap_probability(float(sums.sum(axis=0)[0, 0]) / noise)
        chances = {name: gap * float(np.mean(values)) for name, values in kept.items()}
        unknown = gap * float(np.clip(np.mean(left), 0.0, 1.0))
        return CaseAnswer(effects=chances, unknown=unknown, none=1.0 - gap)

    def _stlsq(
        self, total: FloatArray, groups: Sequence[tuple[Candidate, list[int]]]
    ) -> tuple[list[Candidate], FloatArray, float]:
        """Return the groups that are kept, all coefficients, and the share of the energy that is left."""
        active = list(groups)
        energy = float(total[0, 0])
        while True:
            columns = [column for _, own in active for column in own]
            xi = np.zeros(len(total))
            scale = np.sqrt(np.maximum(np.diag(total)[columns], 1e-30))
            normal = total[np.ix_(columns, columns)] / np.outer(scale, scale)
            right = total[columns, 0] / scale
            xi[columns] = np.linalg.solve(normal + self.ridge * np.eye(len(columns)), right) / scale
            size = {item.name: float(xi[own] @ total[np.ix_(own, own)] @ xi[own]) for item, own in active}
            large = [
                (item, own)
                for item, own in active
                if item.kind.calibrates or size[item.name] >= self.threshold * energy
            ]
            if len(large) == len(active):
                break
            active = large
        rest = energy - 2.0 * xi @ total[:, 0] + xi @ total @ xi
        return [item for item, _ in active], xi, float(rest / max(energy, 1e-30))


def _products(runs: Sequence[RecordedRun], nominal: Nominal, every: Sequence[Candidate]) -> FloatArray:
    """Return products of the residual (column 0) and all members' responses, summed over segments."""
    found = []
    for run in runs:
        motion = InverseMotion(run, nominal)
        responses = [motion.thinned(motion.response(member)) for item in every for member in item.members]
        signals = np.stack([motion.residual, *responses])
        length = max(2, round(SEGMENT_S / (STRIDE * run.period_s)))
        for first in range(0, signals.shape[1], length):
            piece = signals[:, first : first + length]
            found.append(piece @ piece.T)
    return np.stack(found)


def _best_of_class(total: FloatArray, every: Sequence[Candidate]) -> list[tuple[Candidate, list[int]]]:
    """Return the candidate of each class that explains most beside the nominal parameters, with its columns."""
    columns, first = {}, 1
    for place, item in enumerate(every):
        columns[place] = list(range(first, first + len(item.members)))
        first += len(item.members)
    paper = [column for place, item in enumerate(every) if item.kind.calibrates for column in columns[place]]
    best: dict[str, tuple[float, int]] = {}
    for place, item in enumerate(every):
        used = sorted({*paper, *columns[place]})
        scale = np.sqrt(np.maximum(np.diag(total)[used], 1e-30))
        right = total[used, 0] / scale
        solution = np.linalg.lstsq(total[np.ix_(used, used)] / np.outer(scale, scale), right, rcond=1e-9)[0]
        explained = float(right @ solution)
        if item.name not in best or explained > best[item.name][0]:
            best[item.name] = explained, place
    return [(every[place], columns[place]) for _, place in best.values()]


def _limits(nominal: Nominal) -> dict[str, float]:
    """Return the standard deviation of each kind of nominal parameter, over all places that it is corrected at."""
    found: dict[str, float] = {}
    for item in nominal_parameters(nominal):
        size = item.size(nominal.drive)
        found[item.kind] = float(np.hypot(found.get(item.kind, 0.0), size))
    return found
