"""EMPS from the voltage alone: the field's score, the position in mm, for parameters that estimators find here.

`FDBENCH_DATA=FOLDER python benchmarks/emps_open_loop.py`: the four parameters of each row are simulated from rest under
the force that was commanded in the record, and the root mean square error of the position is printed in mm, as
nonlinearbenchmark.org has it. The last row is fitted to that error. `fdbench run --scenario EMPS-v1` scores another
task: the force in closed loop.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from fdbench.estimator import FloatArray, construct
from fdbench.plants._controllers import OpenLoop
from fdbench.plants.feed_drive import FeedDrive, LinearMotor
from fdbench.record import Record
from fdbench.scenario import load_scenario
from fdbench.simulate.system import Sampled, Setup, Timing

NAMES = ("mass_kg", "viscous_friction_N_s_per_m", "coulomb_friction_N", "offset_N")
ROWS = ("null", "least_squares", "idim_iv", "output_error", "pl_lssvm", "krls_t", "kalman", "joint_kalman")
FAR = 100.0  # m and m/s, which no simulation reaches


def errors_m(drive: FeedDrive, record: Record, found: Mapping[str, float]) -> FloatArray:
    """Return the error of the position (n,) with other parameters, under the force of the record."""
    mass, viscous, coulomb, offset = (found[name] for name in NAMES)
    friction, constant = drive.effects
    axis = replace(
        drive,
        travel_m=FAR,
        velocity_limit_m_per_s=FAR,
        motor=LinearMotor(mass_kg=mass, viscous_friction_N_s_per_m=viscous),
        controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1e6),
        effects=(friction.changed(coulomb_force_N=coulomb), constant.changed(constant_force_N=offset)),
    )
    force, way, step_s = record["motor_force_N"], record["motor_position_m"], record.sampling_time_s
    # With a mass of 1 kg in its feed-forward, the loop gives out what is commanded as an acceleration.
    reference = np.column_stack((np.full(len(force), way[0]), np.zeros(len(force)), force))
    timing = Timing(sampling_time_s=step_s, duration_s=len(force) * step_s, substeps=10)
    system = axis.system(Setup(timing=timing, motion=Sampled(reference)))
    system.start([0])
    found_m = system.advance(system.n_samples)[:, system.columns.index("motor_position_m"), 0]
    return np.asarray(found_m - way)


def main() -> None:
    """Fit, simulate and print the table."""
    scenario = load_scenario("EMPS-v0")
    context, (record, _) = scenario.context(), scenario.observe(0)
    drive = context.plant
    if not isinstance(drive, FeedDrive):
        raise TypeError(f"{scenario.id}: a feed drive is expected.")
    parameters = {name: construct(name, {}).fit(context, record).parameters for name in ROWS}
    start = np.array([parameters["null"][name] for name in NAMES])

    def left(factors: FloatArray) -> FloatArray:
        return 1e3 * errors_m(drive, record, dict(zip(NAMES, (start * factors).tolist(), strict=True)))

    fitted = start * least_squares(left, np.ones(4), diff_step=np.full(4, 1e-4)).x
    parameters["open loop, fitted to this error"] = dict(zip(NAMES, fitted.tolist(), strict=True))
    print(f"| parameters of | position, mm | {' | '.join(NAMES)} |\n|{' --- |' * 6}")
    for name, found in parameters.items():
        error_mm = 1e3 * math.sqrt(np.mean(errors_m(drive, record, found) ** 2))
        print(f"| {name} | {error_mm:.2f} | {' | '.join(f'{found[part]:.4g}' for part in NAMES)} |")


if __name__ == "__main__":
    main()
