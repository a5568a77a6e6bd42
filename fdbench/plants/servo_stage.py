"""Servo stage: a mass that follows its commanded position through a spring and a damper."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.effects import Port
from fdbench.plants._servo_stage import StagePlant
from fdbench.simulate.stability import check_substep
from fdbench.simulate.stage import Response, StageSystem
from fdbench.simulate.system import Setup
from fdbench.specification import nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class ServoStage(StagePlant):
    r"""One axis whose servo acts as a spring and a damper between command and table.

    .. math:: m \ddot x + c \dot x + k x + H = k x_d + c \dot x_d

    H is the sum of the effects, which the nominal model lacks. The model for estimators is ``servo_response``.

    Parameters
    ----------
    mass_kg, damping_N_s_per_m, stiffness_N_per_m : float
        m, c, k.

    References
    ----------
    Chou, Duan, Okwudire, A linear hybrid model for enhanced servo error pre-compensation of feed drives with unmodeled
    nonlinear dynamics, CIRP Annals, eq. (11).
    """

    mass_kg: float = positive()
    damping_N_s_per_m: float = nonnegative()
    stiffness_N_per_m: float = positive()

    def axes(self) -> Mapping[str, Response]:
        r"""Return the axis with the states :math:`x` and :math:`\dot x - (c/m) x_d`."""
        m, c, k = self.mass_kg, self.damping_N_s_per_m, self.stiffness_N_per_m
        response = Response(
            A=np.array([[0.0, 1.0], [-k / m, -c / m]]),
            B=np.array([c / m, k / m - (c / m) ** 2]),
            F=np.array([0.0, -1.0 / m]),
            C=np.array([1.0, 0.0]),
            table=np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, c / m, 0.0], [-k, -c, k - c**2 / m, c]]),
        )
        return {"": response}

    def system(self, setup: Setup, n_lanes: int = 1) -> StageSystem:
        """Return the stage with the setup's effects; a substep that is too long for them is refused."""
        timing, masses = setup.timing, {Port.TABLE_FORCE: self.mass_kg}
        check_substep(setup.unmodelled, masses, timing.sampling_time_s, timing.substeps)
        return super().system(setup, n_lanes)
