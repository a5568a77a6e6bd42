"""What an effect is: a port, parameters with units and bounds, hidden states, and one kernel.

The simulator and the diagnosis call the same kernel. Nothing outside this package names an effect.
"""

import dataclasses
import enum
import inspect
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from numba import njit

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
    TRANSMISSION      motor position minus table position, m      part of it that does not stretch the screw, m
    MOTOR_ENCODER     position read on the motor side, m          position read, m
    TABLE_SCALE       position read at the table, m               position read, m
    LOGGING           1 if the previous sample was held, else 0   1 if this sample repeats the last one, else 0
    ================  ==========================================  =============================================

    The slope is d force/d velocity over the substep in N s/m, never negative (tangent or secant); the integrator uses
    it to stay stable. Effects of one port act in the order of the scenario: forces add up, the others form a chain.
    """

    COMMAND = "command"
    MOTOR_FORCE = "motor_force"
    TABLE_FORCE = "table_force"
    TRANSMISSION = "transmission"
    MOTOR_ENCODER = "motor_encoder"
    TABLE_SCALE = "table_scale"
    LOGGING = "logging"

    @property
    def is_force(self) -> bool:
        """Whether kernels of this port return a force and its slope."""
        return self in (Port.MOTOR_FORCE, Port.TABLE_FORCE)


LEADING_ARGUMENTS = ("t", "h", "x", "v", "u")


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel: strict IEEE arithmetic, no allocation, no exceptions on division by zero.

    Signature ``(t, h, x, v, u, [r,] *parameters, *states)``: time at the middle of the substep (s), substep (s),
    position (m) and velocity (m/s) of the port's side, what passes the port (see `Port`), a standard uniform number
    if the effect is random, the parameters by symbol, the hidden states at the start of the substep. It returns
    the port's value and the hidden states at the end of the substep, in that order.
    """
    return njit(error_model="numpy", forceinline=True)(function)


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect; its unit is the suffix of its name."""

    name: str
    symbol: str
    low: float
    high: float
    typical: float

    @property
    def unit(self) -> str:
        """Unit that the name states."""
        return unit_of(self.name)


def parameter(symbol: str, *, low: float, high: float, typical: float) -> Any:
    """Declare a parameter: its symbol in the kernel, its closed bounds, and a typical size for a small axis."""
    return dataclasses.field(metadata={"symbol": symbol, "low": low, "high": high, "typical": typical})


class Effect(ABC):
    """Base of all effects: a frozen keyword-only dataclass of parameters with a compiled ``kernel``.

    Class attributes
    ----------------
    port : Port
    states : tuple of str
        Symbols of the hidden states, which start at zero.
    amplitude : str
        Name of the parameter that scales the effect: at zero there is none.
    random : bool
        Whether the kernel takes a standard uniform number, drawn once for each sample.
    disturbance : bool
        Whether the effect is a process force to be estimated, and not a property of the drive.
    follows_command : bool
        Whether v is the commanded velocity instead of the actual one.
    """

    name: ClassVar[str]
    port: ClassVar[Port]
    states: ClassVar[tuple[str, ...]] = ()
    amplitude: ClassVar[str]
    random: ClassVar[bool] = False
    disturbance: ClassVar[bool] = False
    follows_command: ClassVar[bool] = False
    kernel: ClassVar[Any]
    expected_failures: ClassVar[Mapping[str, str]] = {}

    def __post_init__(self) -> None:
        check_bounds(self)

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the declared parameters in the order of the kernel's arguments."""
        if not dataclasses.is_dataclass(cls):
            raise PluginError(f"{cls.__module__}: {cls.__name__} must be a frozen keyword-only dataclass.")
        return tuple(Parameter(field.name, **field.metadata) for field in dataclasses.fields(cls))

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

    def values(self) -> tuple[float, ...]:
        """Return the parameter values in the order of the kernel's arguments."""
        return tuple(float(getattr(self, item.name)) for item in self.parameters())


effects: Registry[Effect] = Registry("effect", Effect)
reads_plugins_of(effects)
