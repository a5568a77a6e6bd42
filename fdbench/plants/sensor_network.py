"""Spindle and feed drive under one cutting force, with three sensors as nodes of a network."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError, did_you_mean
from fdbench.plants._linear_system import LinearSystem, continuous
from fdbench.plants._plant import Plant, StateSpace
from fdbench.plants._spindle_modal import joined
from fdbench.plants._state_space import StateSpaceModel
from fdbench.plants.feed_drive import RotaryMotor
from fdbench.plants.spindle import Spindle
from fdbench.record import FloatArray
from fdbench.simulate.modal import ModalSystem
from fdbench.simulate.system import Setup
from fdbench.specification import check_bounds, positive

NODES = ("displacement_m", "motor_velocity_m_per_s", "motor_position_m")
NOISES = {"displacement_m": "displacement_m", NODES[1]: "velocity_m_per_s", NODES[2]: "motor_position_m"}


@final
@dataclass(frozen=True, kw_only=True)
class Deviations:
    """Standard deviations of the states: displacement of each mode, velocity and position of the drive."""

    displacement_m: float = positive()
    velocity_m_per_s: float = positive()
    position_m: float = positive()

    def __post_init__(self) -> None:
        check_bounds(self)

    def variances(self, n_modal: int) -> FloatArray:
        """Return the variances of ``n_modal`` modal states, of the velocity and of the position."""
        drive = [self.velocity_m_per_s**2, self.position_m**2]
        return np.array([self.displacement_m**2] * n_modal + drive)


@final
@dataclass(frozen=True, kw_only=True)
class SensorNetwork(Plant):
    r"""One force F on the modes of a spindle and, against motion, on a feed drive without current.

    .. math:: \delta = \Phi(s) F, \qquad m \dot v = -B v - F, \quad \dot x = v

    Nodes: the spindle's displacement, and velocity and position of the motor in the table's coordinates. Each reads
    one output; nodes with a link tell each other. Model ``state_space``, with the displacement as target.

    Source: Salehi (2013), section 5.2, which describes the filters and has no example; values are ours.

    Parameters
    ----------
    spindle : Spindle
    motor : RotaryMotor
        Moved without table or current.
    velocity_noise_m_per_s, position_noise_m : float
        Standard deviations of the readings at the motor, as data sheets give them.
    travel_m, velocity_limit_m_per_s : float
    links : tuple of pairs of str
        Which nodes tell each other, by the columns that they read.
    initial, process : Deviations
        How far from zero each state may start, and what a sampling time may add to it beside the force.
    """

    spindle: Spindle
    motor: RotaryMotor
    velocity_noise_m_per_s: float = positive()
    position_noise_m: float = positive()
    travel_m: float = positive()
    velocity_limit_m_per_s: float = positive()
    links: tuple[tuple[str, str], ...]
    initial: Deviations
    process: Deviations

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in [name for link in self.links for name in link]:
            if name not in NODES:
                raise SpecError(f"links: unknown node '{name}'.{did_you_mean(name, NODES)}")

    def neighbours(self) -> NDArray[np.bool_]:
        """Return which nodes hear each other, (3, 3); every node hears itself."""
        heard = np.eye(len(NODES), dtype=np.bool_)
        for a, b in self.links:
            heard[NODES.index(a), NODES.index(b)] = heard[NODES.index(b), NODES.index(a)] = True
        return heard

    def _pairs(self) -> FloatArray:
        """Return the modes and, as last pair, velocity and position of the drive."""
        mass, friction = self.motor.mass_kg, self.motor.viscous_friction_N_s_per_m
        drive = np.array([[-friction / mass, 0.0, -1.0 / mass], [1.0, 0.0, 0.0]])
        return np.stack([mode.pair for mode in self.spindle.modes] + [drive])

    def _outputs(self) -> dict[str, FloatArray]:
        n = 2 * len(self.spindle.modes)
        modal = np.append(np.tile([1.0, 0.0], len(self.spindle.modes)), [0.0, 0.0])
        return dict(zip(NODES, (modal, np.eye(n + 2)[n], np.eye(n + 2)[n + 1]), strict=True))

    def system(self, setup: Setup, n_lanes: int = 1) -> ModalSystem:
        """Return spindle and drive with the setup's effects as their force."""
        setup.noise.check_only(set(NOISES.values()), "a sensor network")
        limits = self.spindle.displacement_limit_m, self.velocity_limit_m_per_s, self.travel_m
        return ModalSystem(
            self._pairs(),
            self._outputs(),
            dict(zip(NODES, limits, strict=True)),
            {name: getattr(setup.noise, NOISES[name]) for name in NODES},
            self.spindle.commanded(),
            setup,
            n_lanes,
        )

    def state_space(self, sampling_time_s: float) -> StateSpace:
        """Return modes and drive with the three readings as outputs."""
        A, E = joined(self._pairs())
        n_modal = len(A) - 2
        deviations = self.spindle.sensor_noise_m, self.velocity_noise_m_per_s, self.position_noise_m
        return StateSpace(
            A=A,
            B=np.empty((len(A), 0)),
            E=E,
            C=np.stack(list(self._outputs().values())),
            inputs=(),
            outputs=NODES,
            input_variances=np.empty(0),
            output_variances=np.array(deviations) ** 2,
            initial_variances=self.initial.variances(n_modal),
            process_variances=self.process.variances(n_modal),
        )

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the three readings for a force; see `LinearisedPlant`."""
        space = self.state_space(sampling_time_s)
        return continuous(space.A, space.E[:, None], space.C, ["force_N"], space.outputs, sampling_time_s)

    def linear_models(self) -> tuple[StateSpaceModel]:
        """Return the one model, ``state_space``; its target is the spindle's displacement."""
        return (
            StateSpaceModel(
                plant=self, disturbance_gain=lambda _space, _period: self.spindle.static_compliance_m_per_N
            ),
        )
