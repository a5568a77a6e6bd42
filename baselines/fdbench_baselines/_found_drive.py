"""The feed drive that an estimate describes: the nominal one, turned to what was found."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from fdbench.errors import SpecError
from fdbench.estimator import Context, Estimate, FloatArray
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import Record
from fdbench_baselines._friction_motion import LOOP, PHYSICAL, Rigid, frictions, sheet
from fdbench_baselines._simulated_drive import LEAST, knobs_of, turned
from fdbench_baselines.output_error import commanded


def found_drive(
    context: Context, parameters: Mapping[str, float], shapes: Mapping[str, float] = MappingProxyType({})
) -> FeedDrive:
    """Return the nominal drive turned to physical parameters, and to shapes of its friction.

    ``shapes`` are logarithms over the nominal values, by the names of `shape_knobs`.
    """
    plant = context.plant
    if not isinstance(plant, FeedDrive):
        raise SpecError(f"the plant of {context.model} is no feed drive.")
    paper, rigid = sheet(context), Rigid(*[parameters.get(name, 0.0) for name in PHYSICAL])
    level = rigid.coulomb_N / paper.coulomb_N - 1.0 if paper.has_friction else 0.0
    offset = (rigid.offset_N - paper.offset_N) / (abs(paper.coulomb_N) or 1.0)
    moved = {
        "mass": rigid.mass_kg / paper.mass_kg - 1.0,
        "viscous_friction": (rigid.viscous_N_s_per_m - paper.viscous_N_s_per_m) / (paper.linear_N_s_per_m or 1.0),
        **{f"effects.{k}": level if e in frictions(plant) else offset for k, e in enumerate(plant.effects)},
        **shapes,
    }
    knobs = knobs_of(plant)
    settings = np.array([moved.get(knob.name, 0.0) for knob in knobs])
    factors = np.array([knob.is_stated for knob in knobs])
    settings[factors] = np.maximum(settings[factors], LEAST)
    return turned(plant, knobs, settings)


def simulated_target(
    context: Context, estimate: Estimate, shapes: Mapping[str, float], command: Record
) -> FloatArray | None:
    """Return the target (n_rows,) of an axis as it was found, simulated from a command alone; None in other models.

    ``shapes`` are logarithms over the nominal values, by the names of `shape_knobs`.
    """
    if context.model == LOOP or not isinstance(context.plant, FeedDrive):
        return None
    drive = found_drive(context, estimate.parameters, shapes)
    return context.regression(drive.respond(commanded(command))).target
