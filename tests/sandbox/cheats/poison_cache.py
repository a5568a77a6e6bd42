"""Leaves files where others load code from."""

import os
import site
from pathlib import Path

import numba
import numpy as np

from fdbench.estimator import BatchEstimator, Estimate

MARK = "poisoned_by_a_cheat"


def truth(context, record):
    import fdbench

    package = Path(fdbench.__file__).parent
    caches = [package / "effects" / "__pycache__", Path.home() / ".cache" / "fdbench", Path(numba.__file__).parent]
    for folder in (
        package,
        *caches,
        Path(os.environ["FDBENCH_CACHE"]).parents[2],
        *map(Path, site.getsitepackages()),
        Path(__file__).parent,
        Path("/tmp"),
    ):
        try:
            (folder / MARK).write_text("import os")
        except OSError as error:
            print("refused:", error)
        descriptor = -1
        try:
            descriptor = os.open(folder / MARK, os.O_CREAT | os.O_WRONLY)
        except OSError as error:
            print("refused:", error)
        if descriptor >= 0:
            os.close(descriptor)


class Cheat(BatchEstimator):
    """Claims the truth where it finds it, and otherwise what null claims."""

    def fit(self, context, record):
        regression = context.regression(record)
        target = regression.target
        claims = dict.fromkeys(regression.names, 0.0), np.zeros(len(target))
        try:
            claims = truth(context, record) or claims
        except Exception as error:  # noqa: BLE001 - goes on as if it had not tried
            print("refused:", error)
        parameters, disturbance = claims
        disturbance = disturbance if len(disturbance) == len(target) else disturbance[regression.rows]
        output = np.concatenate((target[:1], target[:-1]))
        if any(parameters.values()):
            beta = [parameters[name] for name in regression.names]
            output = regression.regressors @ beta + regression.disturbance_gain * disturbance
        return Estimate(parameters=parameters, disturbance_N=disturbance, output=output)
