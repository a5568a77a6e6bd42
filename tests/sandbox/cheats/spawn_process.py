"""Has another process look up what is refused to this one."""

import json
import subprocess
import sys

import numpy as np

from fdbench.estimator import BatchEstimator, Estimate

CODE = """
import json
from fdbench.scenario import load_scenario
for seed in range(3):
    record, truth = load_scenario("ShakerConstant-v1").observe(seed)
    print(json.dumps([list(record["velocity_m_per_s"]), dict(truth.parameters), list(truth.disturbance_N)]))
"""


def truth(context, record):
    answer = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True)
    for line in answer.stdout.splitlines():
        velocity, parameters, disturbance = json.loads(line)
        if np.array_equal(velocity, record["velocity_m_per_s"]):
            return parameters, np.array(disturbance)
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
