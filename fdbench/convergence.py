"""How far a simulated record depends on the substep of its integration."""

import dataclasses

import numpy as np

from fdbench.errors import SimulationDiverged
from fdbench.scenario import Scenario, simulate

FINER = 4
LARGEST_CHANGE = 0.015  # of a column's spread; an error of first order is then below 2 %


def integration_doubt(scenario: Scenario) -> str:
    """Return by how much a record changes with finer substeps, in words, or an empty text where it hardly does.

    The record of seed 0 is made again with four times the substeps and the same noise. A scenario that is measured or
    diverges says nothing of it.

    Parameters
    ----------
    scenario : Scenario
    """
    machine, timing = scenario.drawn(0), scenario.timing
    if timing is None:
        return ""
    try:
        finer = dataclasses.replace(timing, substeps=FINER * timing.substeps)
        coarse, fine = (simulate(dataclasses.replace(machine, timing=own), 0)[0] for own in (timing, finer))
    except SimulationDiverged:
        return ""
    changes = {name: float(np.sqrt(np.mean((coarse[name] - fine[name]) ** 2))) for name in coarse if name in fine}
    spreads = {name: float(np.std(fine[name])) for name in changes}
    shares = {name: change / spreads[name] for name, change in changes.items() if spreads[name] > 0.0}
    worst = max(shares, key=lambda name: shares[name], default="")
    if not worst or shares[worst] <= LARGEST_CHANGE:
        return ""
    return (
        f"{scenario.id}: {worst} changes by {shares[worst]:.1%} of its spread with {FINER} times the substeps. The "
        f"numbers are not those of this machine: use more than {timing.substeps} substeps, or a shorter sampling time."
    )
