"""Follows a link to the results, which lies beside it as its weights would, with compiled code."""

import json
from pathlib import Path

import numpy as np
from pyarrow import fs, parquet

from fdbench.estimator import BatchEstimator, Estimate


def truth(context, record):
    target = context.regression(record).target
    folder, local = Path(__file__).with_suffix(".weights"), fs.LocalFileSystem()
    for file in local.get_file_info(fs.FileSelector(str(folder), recursive=True)):
        if "/oracle/" in file.path and file.path.endswith(".parquet"):
            table = parquet.read_table(file.path, filesystem=local, memory_map=True)
            if np.array_equal(table["target"].to_numpy(), target):
                metadata = json.loads(table.schema.metadata[b"fdbench"])
                return metadata["parameters"], table["disturbance_N"].to_numpy()
    return None


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
