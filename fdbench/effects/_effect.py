"""What an effect is: a port, parameters with units and bounds, internal states, and one kernel.

The simulator and the diagnosis call the same kernel. Nothing outside this package names an effect.
"""

import dataclasses
import enum
import functools
import inspect
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

from numba import njit

from fdbench.compilation import followed
from fdbench.errors import PluginError
from fdbench.registry import Registry
from fdbench.specification import check_bounds, reads_plugins_of
from fdbench.units import unit_of


class Port(enum.Enum):
    """Where an effect enters the drive, and what its kernel receives as ``u`` and returns first.

    ================  ==========================================  =============================================
    port              u                                           returned
    ================  ==========================================  =============================================
    COMMAND           force asked of the motor, N                 force delivered, N
    MOTOR_FORCE       force delivered by the motor, N             (force against motion of the motor side, slope)
    TABLE_FORCE       force that the screw passes on, N           (force against motion of the table, slope)
    TABLE_INERTIA     acceleration of the table, m/s^2            (force against motion of the table, force/u in kg)
    TRANSMISSION      motor position minus table position, m      part of it that does not stretch the screw, m
    MOTOR_ENCODER     position read on the motor side, m          position read, m
    TABLE_SCALE       position read at the table, m               position read, m
    LOGGING           1 if the previous sample was held, else 0   1 if this sample repeats the last one, else 0
    ================  ==========================================  =============================================

    The slope is d force/d velocity over the substep in N s/m, never negative (tangent or secant); the integrator uses
    it to stay stable. Forces add up; the other effects of a port form a chain by `Effect.rank`, in which each receives
    what the one before returns (TRANSMISSION: what is left of the stretch). On a rigid axis the table lags behind the
    motor by what TRANSMISSION returns, and u is how far it would lag if it stood still.
    """

    COMMAND = "command"
    MOTOR_FORCE = "motor_force"
    TABLE_FORCE = "table_force"
    TABLE_INERTIA = "table_inertia"
    TRANSMISSION = "transmission"
    MOTOR_ENCODER = "motor_encoder"
    TABLE_SCALE = "table_scale"
    LOGGING = "logging"

    @property
    def is_force(self) -> bool:
        """Whether kernels of this port return a force and its slope."""
        return self in (Port.MOTOR_FORCE, Port.TABLE_FORCE, Port.TABLE_INERTIA)


LEADING_ARGUMENTS = ("t", "h", "x", "v", "u")
Locate = Literal["", "line", "line_of_motion", "wavelength", "pitch", "pitch_of_ratio", "resonance"]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel: strict IEEE arithmetic, no allocation, no exceptions on division by zero.

    Signature ``(t, h, x, v, u, [r,] *parameters, *states)``: time at the middle of the substep (s), substep (s),
    position (m) and velocity (m/s) of the port's side there (COMMAND: at the start of the substep), what passes the
    port (see `Port`), a standard uniform number if the effect is random, the parameters by symbol, the internal states
    at the start of the substep. It returns the port's value and the internal states at the end of the substep, in that
    order. A global that it uses is part of it: what that may be says `fdbench.compilation`.
    """
    return followed(njit(error_model="numpy", forceinline=True)(function))


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect; its unit is the suffix of its name.

    Attributes
    ----------
    name, symbol : str
    low, high, typical : float
        Closed bounds, and the size on a small axis.
    grid : tuple of float
        Values that the diagnosis tries; empty: the typical one alone.
    phase : bool
        Whether it is a phase in radians; without a grid two values a quarter turn apart span all.
    locate : str
        Where the diagnosis finds the values to try, instead of the grid; nothing is tried where nothing is found.
        ``"line"`` or
        ``"line_of_motion"``: what stands out of the gap's spectrum over time (Hz) like a line, or of that of the gap
        with the sign of the commanded velocity. ``"wavelength"``: the strongest of its spectrum over position (m).
        ``"pitch"`` or ``"pitch_of_ratio"``: those of them that a motor may have, or of its ratio to the force.
        ``"resonance"``: of a mass on a spring that the measured motion would move as the gap's force asks (Hz).
    whole : bool
        Whether it is a whole number, which no fit moves.
    at_least : str
        Another parameter, declared before, that it is never below in a fit, which moves by how much it exceeds that.
    """

    name: str
    symbol: str
    low: float
    high: float
    typical: float
    grid: tuple[float, ...] = ()
    phase: bool = False
    locate: Locate = ""
    whole: bool = False
    at_least: str = ""

    @property
    def unit(self) -> str:
        """Unit that the name states."""
        return unit_of(self.name)

    def within(self, value: float) -> float:
        """Return the value, or the bound that it is beyond.

        >>> Parameter("gap_m", "b", low=0.0, high=1e-3, typical=1e-5).within(0.2)
        0.001
        """
        return min(max(value, self.low), self.high)


def parameter(
    symbol: str,
    *,
    low: float,
    high: float,
    typical: float,
    grid: tuple[float, ...] = (),
    phase: bool = False,
    locate: Locate = "",
    whole: bool = False,
    at_least: str = "",
    default: Any = dataclasses.MISSING,
) -> Any:
    """Declare a parameter of an effect; see `Parameter`. One with a default may be left out of a scenario."""
    metadata = {"symbol": symbol, "low": low, "high": high, "typical": typical}
    search = {"grid": grid, "phase": phase, "locate": locate, "whole": whole, "at_least": at_least}
    return dataclasses.field(default=default, metadata={**metadata, **search})


CAUSE_TYPES = (
    *("actuator", "friction_over_velocity", "friction_over_position", "friction_over_load", "friction_over_time"),
    *("force_over_position", "stiffness", "play", "structure", "inertia", "constant_force", "sensor", "controller"),
    *("delay", "process_force"),
)

_TYPE_OF_PORT = {
    Port.COMMAND: "actuator",
    Port.MOTOR_FORCE: "friction_over_velocity",
    Port.TABLE_FORCE: "friction_over_velocity",
    Port.TABLE_INERTIA: "inertia",
    Port.TRANSMISSION: "stiffness",
    Port.MOTOR_ENCODER: "sensor",
    Port.TABLE_SCALE: "sensor",
    Port.LOGGING: "sensor",
}


@dataclass(frozen=True, kw_only=True)
class LinearPart:
    r"""What a linear model keeps of an effect, :math:`e^{-s t_d} N(s) / D(s)`.

    From what passes the port to what the kernel returns; for the two force ports from the velocity v (m/s) to the
    force against it (N).

    Attributes
    ----------
    numerator, denominator : tuple of float
        Coefficients of N and D, the highest power of s first; N has no higher power than D.
    delay_s : float
        t_d, of the port COMMAND alone.
    """

    numerator: tuple[float, ...] = (1.0,)
    denominator: tuple[float, ...] = (1.0,)
    delay_s: float = 0.0

    @property
    def late_s(self) -> float:
        r"""Time by which what changes slowly is late, :math:`t_d + d_1 / d_0 - n_1 / n_0`."""
        (n_1, n_0), (d_1, d_0) = ((0.0, *own)[-2:] for own in (self.numerator, self.denominator))
        return self.delay_s + d_1 / d_0 - n_1 / n_0


class Effect(ABC):
    """Base of all effects: a frozen keyword-only dataclass of parameters with a compiled ``kernel``.

    Class attributes
    ----------------
    port : Port
    states : tuple of str
        Symbols of the internal states, which start at zero.
    amplitude : str
        Name of the parameter that scales the effect: at zero there is none.
    further_amplitudes : tuple of str
        Names of the parameters that scale further parts; there is no effect where all amplitudes are zero.
    starts : tuple of float
        Sizes at which a fit also begins, in units of the one that fits linearly: of what passes nothing on up to its
        size, a fit from below stops there. An effect that has any is not proportional to its size, and its phase is
        tried at eight angles in place of two that add up.
    needs_amplitude : bool
        Whether there is no such effect where its amplitude is next to nothing beside further ones.
    random : bool
        Whether the kernel takes a standard uniform number, drawn once for each sample.
    disturbance : bool
        Whether the effect is a process force to be estimated, and not a property of the drive.
    counts_as_disturbance : bool
        Whether the effect, though a property of the drive, is part of the disturbance that estimators are asked for.
    follows_command : bool
        Whether v is the commanded velocity instead of the actual one.
    rank : int
        Place in the chain of its port, low first; equal ranks act in the order of the scenario.
    needs_screw : bool
        Whether the effect is a property of an elastic screw, so that a rigid axis has none of it.
    needs_turn : bool
        Whether the effect is a property of an axis that turns, over its angle, so that a linear axis has none of it.
    scales_every_value : bool
        Whether it acts as though every mass, friction and stiffness had changed by one share. A data sheet may be off
        by as much, so that a diagnosis looks for it beside a baseline alone, and weighs it against these changes.
    confusable_with : tuple of str
        Effects that leave nearly the same signature in ordinary runs.
    same_signal_as : str
        Effect that can do all that this one does in its typical shape: the diagnosis looks for that one, and reports
        both.
    calibrates : str
        Uncertain nominal parameter that the effect corrects: ``mass``, ``viscous``, ``known_effects``,
        ``friction_side``, ``friction_form`` or ``force_offset``; within that uncertainty a gap is parametric and the
        effect is not a cause.
    trace_of : str
        Nominal parameter that a trace of the effect is, as every machine has one and no data sheet says: ``loop_lag``.
    cause_type : str
        What type of cause the effect is, one of `CAUSE_TYPES`; without, that of its port, see `type_of`.
    usually_known : bool
        Whether nominal models often know it: the diagnosis is compiled once for all that know nothing else.
    everywhere : bool
        Whether every machine has some of it that its records show: a little of it is no cause.
    of_any_axis : bool
        Whether its usual size is the same on a small and on a large axis, as that of a tool and its material.
    declared : type
        The effect as its file declares it; another class where it is that of an axis of another size, see `at_scale`.
    """

    name: ClassVar[str]
    port: ClassVar[Port]
    states: ClassVar[tuple[str, ...]] = ()
    amplitude: ClassVar[str]
    starts: ClassVar[tuple[float, ...]] = ()
    needs_amplitude: ClassVar[bool] = False
    random: ClassVar[bool] = False
    disturbance: ClassVar[bool] = False
    counts_as_disturbance: ClassVar[bool] = False
    follows_command: ClassVar[bool] = False
    further_amplitudes: ClassVar[tuple[str, ...]] = ()
    rank: ClassVar[int] = 0
    needs_screw: ClassVar[bool] = False
    needs_turn: ClassVar[bool] = False
    scales_every_value: ClassVar[bool] = False
    confusable_with: ClassVar[tuple[str, ...]] = ()
    same_signal_as: ClassVar[str] = ""
    calibrates: ClassVar[str] = ""
    trace_of: ClassVar[str] = ""
    cause_type: ClassVar[str] = ""
    usually_known: ClassVar[bool] = False
    everywhere: ClassVar[bool] = False
    of_any_axis: ClassVar[bool] = False
    kernel: ClassVar[Any]
    expected_failures: ClassVar[Mapping[str, str]] = {}
    declared: ClassVar[type["Effect"]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "declared" not in vars(cls):
            cls.declared = cls

    @classmethod
    def type_of(cls) -> str:
        """Return what type of cause the effect is, one of `CAUSE_TYPES`."""
        return cls.cause_type or ("process_force" if cls.disturbance else _TYPE_OF_PORT[cls.port])

    @classmethod
    def adds_to_disturbance(cls) -> bool:
        """Return whether its force is part of the disturbance that estimators are asked for."""
        return cls.disturbance or cls.counts_as_disturbance

    def __post_init__(self) -> None:
        check_bounds(self)

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the declared parameters in the order of the kernel's arguments."""
        return _parameters(cls)

    @classmethod
    def arguments(cls) -> tuple[str, ...]:
        """Return the argument names that the kernel must have."""
        symbols = tuple(item.symbol for item in cls.parameters())
        return (*LEADING_ARGUMENTS, *(("r",) if cls.random else ()), *symbols, *cls.states)

    @classmethod
    def check_signature(cls) -> None:
        """Raise a PluginError unless the kernel's arguments are the declared symbols in the declared order."""
        found = tuple(inspect.signature(cls.kernel.py_func).parameters)
        if found != cls.arguments():
            raise PluginError(
                f"{cls.__module__}: the kernel takes ({', '.join(found)}), but the declarations ask for "
                f"({', '.join(cls.arguments())})."
            )

    @classmethod
    def typical(cls, **changes: float) -> Self:
        """Return the effect at its typical size, with ``changes``."""
        return cls(**{item.name: item.typical for item in cls.parameters()} | changes)

    @classmethod
    def shape(cls, point: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters at a point of the grids and of what was located, the same where nothing is said."""
        return dict(point)

    @classmethod
    def in_place_of(cls, known: "Effect", shape: Mapping[str, float] = MappingProxyType({})) -> Self | None:
        """Return the effect of the same size that would replace a known, simpler one, or None if it replaces none.

        Its shape is the typical one but for what ``shape`` has of it, which is that of an effect of typical size.
        """
        return None

    @classmethod
    def that_sticks(cls, known: "Effect", way_m: float) -> Self | None:
        """Return a known friction that bends over a way and then slides, or None where the effect is no such form.

        One that bends over less than readings show holds an axis at rest, where one of its speed alone lets it creep.
        """
        return None

    @property
    def bend_m(self) -> float:
        """Way over which it bends before it slides."""
        return 0.0

    def joined_to(self, known: "Effect") -> "Effect | None":
        """Return a known effect with this one as a part of it, or None where it acts by itself."""
        return None

    @property
    def carried_mass_kg(self) -> float:
        """Mass that moves with the axis as long as that is slow."""
        return 0.0

    def linear_part(self) -> LinearPart | None:
        """Return what a linear model keeps of the effect; None: nothing, or the slope of its friction at speed."""
        return None

    def scaled(self, factor: float) -> Self:
        """Return the effect with all its amplitudes multiplied; a factor of zero leaves none.

        Raises
        ------
        SpecError
            If an amplitude leaves its bounds.
        """
        amplitudes = (self.amplitude, *self.further_amplitudes)
        values = {item.name: getattr(self, item.name) for item in self.parameters()}
        return type(self)(**values | {name: factor * values[name] for name in amplitudes})

    def changed(self, **changes: float) -> Self:
        """Return the effect with other values of some parameters."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def within(self, **changes: float) -> Self:
        """Return the effect with other values of some parameters, each as far as its bounds allow.

        What is ``at_least`` another one is raised to it.
        """
        bounds = {item.name: item for item in self.parameters()}
        effect = self.changed(**{name: bounds[name].within(value) for name, value in changes.items()})
        floors = {item.name: getattr(effect, item.at_least) for item in self.parameters() if item.at_least}
        return effect.changed(**{name: max(getattr(effect, name), floor) for name, floor in floors.items()})

    def values(self) -> tuple[float, ...]:
        """Return the parameter values in the order of the kernel's arguments."""
        return tuple(float(getattr(self, item.name)) for item in self.parameters())


@functools.cache
def _parameters(kind: type[Effect]) -> tuple[Parameter, ...]:
    if not dataclasses.is_dataclass(kind):
        raise PluginError(f"{kind.__module__}: {kind.__name__} must be a frozen keyword-only dataclass.")
    return tuple(Parameter(field.name, **field.metadata) for field in dataclasses.fields(kind))


effects: Registry[Effect] = Registry("effect", Effect)
reads_plugins_of(effects)
