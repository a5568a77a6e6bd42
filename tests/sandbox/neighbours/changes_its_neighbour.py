"""Changes NumPy, the state of its package, its neighbour's class and its neighbour's cache; then fits as that one."""

import os
from pathlib import Path

import numpy as np

from fdbench.estimator import BatchEstimator
from neighbours import _shared
from neighbours.keeps_to_itself import KeepsToItself

lstsq = np.linalg.lstsq


def doubled(*arguments, **options):
    solution, *others = lstsq(*arguments, **options)
    return 2.0 * solution, *others


class ChangesItsNeighbour(BatchEstimator):
    """Claims what its neighbour would claim in this process."""

    def fit(self, context, record):
        np.linalg.lstsq = doubled
        _shared.SCALE[0] = 3.0
        KeepsToItself.factor = 5.0
        cache = Path(os.environ["FDBENCH_CACHE"])
        for folder in (cache.parent, cache.parent / "keeps_to_itself"):
            try:
                (folder / "poisoned_by_a_neighbour").write_text("import os")
            except OSError as error:
                print("refused:", error)
        return KeepsToItself().fit(context, record)
