"""Compose a stepper: the integrator's source with the kernels of one list of effects, as a generated module.

The module lies in the user's cache folder under a name that is the digest of its own text and of everything that its
kernels reach. Editing any of that gives a new file, so stale machine code cannot answer for it.
"""

import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np

from fdbench.compilation import closure_digest, trusted_file
from fdbench.effects import Effect, Port
from fdbench.files import write_text
from fdbench.simulate import integrator, layout

_HEADER = '''"""Generated stepper for {names}, {lanes} lane(s) side by side."""

from numba import njit

from fdbench.compilation import kept, lightly_optimised


def compiled(function):
    return lightly_optimised(kept(njit(error_model="numpy", nogil=True)(function)))


inlined = njit(error_model="numpy", forceinline=True)
LANES = {lanes}
{constants}
'''

_PORT_ARGUMENTS = {
    Port.COMMAND: "u",
    Port.TRANSMISSION: "u, total",
    Port.MOTOR_FORCE: "u, force, slope",
    Port.TABLE_FORCE: "u, force, slope",
    Port.TABLE_INERTIA: "u, force, slope",
    Port.MOTOR_ENCODER: "u",
    Port.TABLE_SCALE: "u",
    Port.LOGGING: "u",
}


def cache_folder() -> Path:
    """Return the folder of generated modules: ``FDBENCH_CACHE``, else the user's cache folder, else a temporary one."""
    base = os.environ.get("FDBENCH_CACHE")
    folder = Path(base) if base else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "fdbench"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return Path(tempfile.mkdtemp(prefix="fdbench-"))


@dataclass(frozen=True)
class Slot:
    """Where one effect lies in a block: its on-flag, parameters and internal states, and its random number."""

    effect: type[Effect]
    flag: int
    first_state: int
    uniform: int

    def parameter(self, index: int) -> int:
        """Return the row of parameter ``index``."""
        return self.flag + 1 + index


@lru_cache(maxsize=256)
def slots(effects: tuple[type[Effect], ...]) -> tuple[Slot, ...]:
    """Lay out the effects behind the fixed rows of a block: flags and parameters first, then all internal states."""
    flags = np.cumsum([layout.FIRST_FREE_ROW, *(1 + len(effect.parameters()) for effect in effects)])
    states = np.cumsum([flags[-1], *(len(effect.states) for effect in effects)])
    uniforms = np.cumsum([0, *(int(effect.random) for effect in effects)])
    return tuple(Slot(e, int(flags[n]), int(states[n]), int(uniforms[n])) for n, e in enumerate(effects))


def block_rows(effects: Sequence[type[Effect]]) -> int:
    """Return the number of rows of a block."""
    return layout.FIRST_FREE_ROW + sum(1 + len(e.parameters()) + len(e.states) for e in effects)


def _call(number: int, slot: Slot) -> str:
    effect = slot.effect

    def row(index: int) -> str:
        return f"w[{index} * LANES + i]"

    states = [row(slot.first_state + j) for j in range(len(effect.states))]
    velocity = "w[COMMANDED_V + i]" if effect.follows_command else "w[v + i]"
    entering = "w[u + i] - w[total + i]" if effect.port is Port.TRANSMISSION else "w[u + i]"
    arguments = ["w[T + i]", "h", "w[x + i]", velocity, entering]
    arguments += [f"uniform[{slot.uniform}, i]"] if effect.random else []
    arguments += [row(slot.parameter(j)) for j in range(len(effect.parameters()))] + states
    targets = ["value", *(["steep"] if effect.port.is_force else []), *(f"z_{j}" for j in range(len(states)))]
    result = ", ".join(targets) if len(targets) > 1 or effect.port is Port.TRANSMISSION else "value"
    if len(targets) == 1:
        result = "(value,)"
    lines = [
        f"    if active[{number}]:",
        "        for i in range(LANES):",
        f"            on = {row(slot.flag)} > 0.5",
        f"            {result} = kernel_{number}({', '.join(arguments)})",
    ]
    if effect.port.is_force:
        lines += [
            "            w[force + i] += value if on else 0.0",
            "            w[slope + i] += steep if on else 0.0",
        ]
        lines += ["            w[PROCESS + i] += value if on else 0.0"] if effect.disturbance else []
    elif effect.port is Port.TRANSMISSION:
        lines += ["            w[total + i] += value if on else 0.0"]
    else:
        lines += ["            w[u + i] = value if on else w[u + i]"]
    lines += [f"            {state} = z_{j} if on else {state}" for j, state in enumerate(states)]
    return "\n".join(lines)


def source(effects: Sequence[type[Effect]], lanes: int) -> str:
    """Return the text of the generated module."""
    constants = [f"{name} = {row * lanes}" for row, name in enumerate(layout.ROWS)]
    constants += [f"{name} = {value}" for name, value in vars(layout).items() if name.startswith("OUT_")]
    calls: dict[Port, list[str]] = {port: [] for port in Port}
    for number, slot in sorted(enumerate(slots(tuple(effects))), key=lambda item: item[1].effect.rank):
        slot.effect.check_signature()
        constants.append(f"kernel_{number} = KERNELS[{number}]  # {slot.effect.__module__}.{slot.effect.__name__}")
        calls[slot.effect.port].append(_call(number, slot))
    names = ", ".join(effect.name for effect in effects) or "no effects"
    text = [_HEADER.format(names=names, lanes=lanes, constants="\n".join(constants))]
    for port, arguments in _PORT_ARGUMENTS.items():
        body = "\n".join(calls[port]) or "    pass"
        text.append(f"@inlined\ndef {port.value}(w, active, h, x, v, {arguments}, uniform):\n{body}\n")
    for function in (integrator.propagate, integrator.measure_and_control, integrator.integrate_substep):
        text.append("@inlined\n" + inspect.getsource(function))
    text.append("@compiled\n" + inspect.getsource(integrator.advance))
    return "\n\n".join(text)


def load(text: str, effects: Sequence[type[Effect]]) -> ModuleType:
    """Return the generated module of this text, in which ``KERNELS`` are the kernels of ``effects``."""
    digest = hashlib.sha256(text.encode())
    for effect in effects:
        digest.update(closure_digest(effect.kernel).encode())
    name = f"stepper_{digest.hexdigest()[:24]}"
    path = trusted_file(f"{name}.py") or cache_folder() / f"{name}.py"
    if not path.exists():
        write_text(path, text)
    specification = importlib.util.spec_from_file_location(f"fdbench_generated.{name}", path)
    if specification is None or specification.loader is None:
        raise ImportError(f"{path}: the generated stepper cannot be loaded.")
    module = importlib.util.module_from_spec(specification)
    vars(module)["KERNELS"] = [effect.kernel for effect in effects]
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


@lru_cache(maxsize=64)
def compose(effects: tuple[type[Effect], ...], lanes: int) -> Callable[..., None]:
    """Return the compiled ``advance`` of the integrator for these effects and this many lanes side by side."""
    advance: Callable[..., None] = load(source(effects, lanes), effects).advance
    return advance
