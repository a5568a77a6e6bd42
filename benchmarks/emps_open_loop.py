"""EMPS from the voltage alone: the four parameters fitted to the field's score, the position in mm.

`FDBENCH_DATA=FOLDER python benchmarks/emps_open_loop.py` fits mass, frictions and offset to
`open_loop_position_error`, in which `fdbench run --scenario EMPSOpenLoop-v0` scores what estimators find, and prints
the error and the parameters: what four parameters can do on this record.
"""

import numpy as np
from scipy.optimize import least_squares

from fdbench.estimator import FloatArray
from fdbench.metrics.open_loop_position_error import PARAMETERS, open_loop_position_m
from fdbench.plants.feed_drive import FeedDrive
from fdbench.scenario import load_scenario
from fdbench.statistics import rms


def main() -> None:
    """Fit and print."""
    scenario = load_scenario("EMPSOpenLoop-v0")
    (record, truth), drive = scenario.observe(0), scenario.plant
    if not isinstance(drive, FeedDrive):
        raise TypeError(f"{scenario.id}: a feed drive is expected.")
    measured, force = record["motor_position_m"], record["motor_force_N"]
    start = np.array([truth.parameters[name] for name in PARAMETERS])

    def error_mm(factors: FloatArray) -> FloatArray:
        found = dict(zip(PARAMETERS, (start * factors).tolist(), strict=True))
        position = open_loop_position_m(drive, force, float(measured[0]), record.sampling_time_s, found)
        return 1e3 * (position - measured)

    factors = least_squares(error_mm, np.ones(4), diff_step=np.full(4, 1e-4)).x
    print(f"published parameters: {rms(error_mm(np.ones(4))):.2f} mm; fitted to it: {rms(error_mm(factors)):.2f} mm")
    for name, value in zip(PARAMETERS, start * factors, strict=True):
        print(f"{name} = {value:.5g}")


if __name__ == "__main__":
    main()
