"""How a controller takes velocity and acceleration of its command, where neither the log nor the model says."""

import dataclasses
from collections.abc import Callable

from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.nominal import Simulation
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.settings import SEARCH
from fdbench.plants._controllers import Cascade

BACKWARD = "backward"


def with_likely_rates(best: Calibrated, anew: Callable[[Simulation], Aligned]) -> Calibrated:
    """Return the re-calibrated model with the rates of its command that are told, or else with the likelier ones.

    A controller that differences its position command has a velocity that is half a cycle late and an acceleration
    that is a cycle late. They are taken where they bring more than naming a cause costs, and still do beside a loop
    that answers late, which looks much like them.

    Parameters
    ----------
    best : Calibrated
        With central differences, where neither is told.
    anew : callable
        Returns the records prepared for a model with other rates.
    """
    nominal, controller = best.ready.nominal, best.ready.nominal.drive.controller
    is_told = nominal.covered.velocity_told or nominal.simulation.command_rates is not None
    if is_told or not isinstance(controller, Cascade) or best.misfit < SEARCH.noise_alone:
        return best
    if controller.velocity_feedforward == 0.0 and controller.acceleration_feedforward_kg == 0.0:
        return best
    backward = dataclasses.replace(nominal.simulation, command_rates=BACKWARD)
    tried = best.surpassed_by(anew(backward), late=True)
    if tried is None:
        return best
    said = (
        "The controller seems to difference its command backwards, each sample from the one before: with rates at the "
        'samples the model fits worse, whatever its values. Write `command_rates = "backward"` under [simulation] of '
        'the model, or `"central"` if that is wrong; or log reference_velocity_m_per_s.'
    )
    return dataclasses.replace(tried, ready=tried.ready.assuming(said))
