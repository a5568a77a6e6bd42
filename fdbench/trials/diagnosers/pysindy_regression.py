"""Sparse regression of the force residual by PySINDy's optimizer and its bagging."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from fdbench.diagnosis.evidence.prepare import merged_runs
from fdbench.diagnosis.model.candidates import candidates
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.search.periods import located
from fdbench.errors import PluginError
from fdbench.record import FloatArray, Record
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser
from fdbench.trials.diagnosers._common import gap_probability
from fdbench.trials.diagnosers._force_residual import InverseMotion, visible


@final
class PysindyRegression(Diagnoser):
    """Nominal force residual against all candidates at once, thresholds on coefficients of columns of unit energy.

    The probability of an effect is the share of bagged models that keep one of its columns. Needs the package pysindy.

    Source: Kaptanoglu et al. (2022), Journal of Open Source Software 7(69).

    Parameters
    ----------
    threshold : float
        Smallest coefficient, relative to the largest.
    ridge : float
    models : int
    """

    def __init__(self, threshold: float = 0.1, ridge: float = 0.05, models: int = 20) -> None:
        self.threshold = threshold
        self.ridge = ridge
        self.models = models

    def diagnose(self, nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> CaseAnswer:
        readings, split = merged_runs(nominal, records, holdouts)
        base = start(nominal)
        every = visible(candidates(base, located(readings, split, base), split.runs[0].period_s))
        runs = [run for run, out in zip(split.runs, split.held_out, strict=True) if not out.all()]
        motions = [InverseMotion(run, nominal) for run in runs]
        columns = [
            np.concatenate([motion.thinned(motion.response(member)) for motion in motions])
            for item in every
            for member in item.members
        ]
        residual = np.concatenate([motion.residual for motion in motions])
        noise = split.noise_models["motor_force_N"].rms ** 2 / min(run.repeats for run in runs)
        kept, left = self._inclusion(np.stack(columns, axis=1), residual)
        chances: dict[str, float] = {}
        first = 0
        for item in every:
            own = float(kept[:, first : first + len(item.members)].any(axis=1).mean())
            chances[item.name] = max(chances.get(item.name, 0.0), own)
            first += len(item.members)
        gap = gap_probability(float(np.mean(residual**2)) / noise)
        return CaseAnswer(
            effects={name: gap * chance for name, chance in chances.items()}, unknown=gap * left, none=1.0 - gap
        )

    def _inclusion(self, columns: FloatArray, residual: FloatArray) -> tuple[FloatArray, float]:
        """Return which columns each model keeps, (n_models, n_columns), and the share of the energy that is left."""
        optimizers = _optimizers()
        scale = np.sqrt(np.mean(columns**2, axis=0))
        design = columns / np.where(scale > 0.0, scale, 1.0)
        level = self.threshold * float(np.sqrt(np.mean(residual**2)))
        bagged = optimizers.EnsembleOptimizer(
            optimizers.STLSQ(threshold=level, alpha=self.ridge * len(residual)), bagging=True, n_models=self.models
        )
        bagged.fit(design, residual[:, None])
        coefficients = np.array(bagged.coef_list)[:, 0]
        left = np.mean((residual - design @ np.median(coefficients, axis=0)) ** 2) / max(np.mean(residual**2), 1e-30)
        return coefficients != 0.0, float(np.clip(left, 0.0, 1.0))


def _optimizers() -> Any:
    try:
        import pysindy.optimizers
    except ModuleNotFoundError as error:
        raise PluginError("pysindy_regression needs pysindy: pip install 'fdbench[peers]'.") from error
    return pysindy.optimizers
