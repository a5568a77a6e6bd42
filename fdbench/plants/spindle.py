"""Spindle whose shaft carries a displacement sensor, from which the force at the tool is to be told."""

from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import SpecError
from fdbench.plants._linear_system import LinearSystem, continuous
from fdbench.plants._plant import Plant, StateSpace
from fdbench.plants._spindle_modal import ComplianceMode, joined
from fdbench.plants._state_space import StateSpaceModel
from fdbench.record import FloatArray
from fdbench.simulate.modal import Commanded, ModalSystem
from fdbench.simulate.system import Setup
from fdbench.specification import nonnegative, positive


@final
@dataclass(frozen=True, kw_only=True)
class Spindle(Plant):
    r"""Displacement of the shaft under a force at the tool tip.

    .. math::
        \Phi(s) = \frac{\delta(s)}{F(s)} = \sum_k \frac{\alpha_k}{s^2 + 2 \zeta_k \omega_k s + \omega_k^2}, \qquad
        G_s = \Phi(0) = \sum_k \frac{\alpha_k}{\omega_k^2}

    The forces are effects on the table, taken along the sensor's direction; the motion is the feed, at which they cut.
    Model ``state_space``: no linear parameters; the target is the displacement, of which the disturbance causes
    :math:`G_s` per newton once the modes have settled.

    Source: Salehi (2013), eq. (3.1) and table 1.

    Parameters
    ----------
    modes : tuple of ComplianceMode
    sensor_noise_m : float
        Standard deviation of a reading, as the sensor's data sheet gives it.
    displacement_limit_m : float
        Range of the sensor.
    feedrate_limit_m_per_s : float
    action : str
        What an action adds to: ``force_N`` or ``feedrate_m_per_s``.
    reference_force_N : float
        Force whose static displacement an adaptive control is to hold.

    Examples
    --------
    >>> mode = ComplianceMode(frequency_Hz=753.0, damping_ratio=0.0297, modal_gain_per_kg=25.756)
    >>> round(mode.compliance_m_per_N * 1e6, 4)  # um/N
    1.1506
    """

    modes: tuple[ComplianceMode, ...]
    sensor_noise_m: float = positive()
    displacement_limit_m: float = positive()
    feedrate_limit_m_per_s: float = positive()
    action: str = "force_N"
    reference_force_N: float = nonnegative(default=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.modes:
            raise SpecError("modes: at least one mode is needed.")
        self.commanded()

    def commanded(self) -> Commanded:
        """Return what lanes of the spindle are asked for."""
        return Commanded(
            action=self.action,
            reference_displacement_m=self.static_compliance_m_per_N * self.reference_force_N,
            feedrate_limit_m_per_s=self.feedrate_limit_m_per_s,
        )

    @property
    def static_compliance_m_per_N(self) -> float:
        """Displacement for one newton of constant force, G_s."""
        return sum(mode.compliance_m_per_N for mode in self.modes)

    def _pairs(self) -> FloatArray:
        return np.stack([mode.pair for mode in self.modes])

    def _output(self) -> FloatArray:
        return np.tile([1.0, 0.0], len(self.modes))

    def system(self, setup: Setup, n_lanes: int = 1) -> ModalSystem:
        """Return the spindle with the setup's effects as its force."""
        setup.noise.check_only({"displacement_m"}, "a spindle")
        return ModalSystem(
            self._pairs(),
            {"displacement_m": self._output()},
            {"displacement_m": self.displacement_limit_m},
            {"displacement_m": setup.noise.displacement_m},
            self.commanded(),
            setup,
            n_lanes,
        )

    def state_space(self, sampling_time_s: float) -> StateSpace:
        """Return the modes, at rest at the start, with the displacement as output."""
        A, E = joined(self._pairs())
        n = len(A)
        return StateSpace(
            A=A,
            B=np.empty((n, 0)),
            E=E,
            C=self._output()[None],
            inputs=(),
            outputs=("displacement_m",),
            input_variances=np.empty(0),
            output_variances=np.array([self.sensor_noise_m**2]),
            initial_variances=np.zeros(n),
            process_variances=np.zeros(n),
        )

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the displacement for a force; see `LinearisedPlant`."""
        space = self.state_space(sampling_time_s)
        return continuous(space.A, space.E[:, None], space.C, ["force_N"], space.outputs, sampling_time_s)

    def linear_models(self) -> tuple[StateSpaceModel]:
        """Return the one model, ``state_space``; its target is the displacement."""
        return (StateSpaceModel(plant=self, disturbance_gain=lambda _space, _period: self.static_compliance_m_per_N),)
