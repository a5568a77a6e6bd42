"""Compose a stepper: the integrator's source with the kernels of some effects, as a generated module.

The module lies in the user's cache folder under a name that is the digest of its own text and of everything that its
kernels reach. Editing any of that gives a new file, so stale machine code cannot answer for it.

Which effects act is told to the machine code in a table of calls. A lane alone is simulated by one stepper of all
effects of this package, whatever it has of them and however often: rows of parameters are in that table too. Lanes side
by side run as vectors where the rows are known to the compiler, so their stepper has a case for each effect of theirs.
"""

import ast
import hashlib
import inspect
import os
import stat
import sys
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numba import jit
from numpy.typing import NDArray

from fdbench.compilation import closure_digest, followed
from fdbench.effects import Effect, Port
from fdbench.effects import effects as registry
from fdbench.errors import FdbenchError, SpecError
from fdbench.files import write_text
from fdbench.simulate import integrator, layout

GENERATED = "fdbench_generated."  # before the names of modules

_HEADER = '''"""Generated stepper for {names}, {lanes} lane(s) side by side."""

from numba import njit

from fdbench.compilation import kept, lightly_optimised


def compiled(function):
    return lightly_optimised(kept(njit(error_model="numpy", nogil=True)(function)), {level})


inlined = njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
LANES = {lanes}
{constants}
'''

MOST_EFFECTS = 64  # on one axis

Shared = tuple[tuple[int, int, float], ...]  # number of the effect, index of the parameter, value

# Beside time step, position and velocity; in the order in which ports are called.
PORT_ARGUMENTS = {
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
    """Return the folder of generated modules: ``FDBENCH_CACHE``, else the user's cache folder, else a temporary one.

    Raises
    ------
    FdbenchError
        If anyone may write there.
    """
    base = os.environ.get("FDBENCH_CACHE")
    folder = Path(base) if base else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fdbench"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        return _temporary_folder()
    if folder.stat().st_mode & stat.S_IWOTH:
        raise FdbenchError(
            f"{folder}: anyone may write there, and machine code that is kept there is run. `chmod o-w` it, or name "
            "another folder by the environment variable FDBENCH_CACHE."
        )
    return folder


@lru_cache(maxsize=1)
def _temporary_folder() -> Path:
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


@lru_cache(maxsize=1)
def core_effects() -> tuple[type[Effect], ...]:
    """Return the effects of this package, in order of name."""
    modules = registry.modules()
    return tuple(registry.get(name) for name, module in modules.items() if module == f"fdbench.effects.{name}")


@lru_cache(maxsize=256)
def of_time_alone(effect: type[Effect]) -> bool:
    """Return whether a force follows from time, command and parameters: its kernel reads nothing else of the axis."""
    if not effect.port.is_force or effect.states or effect.random:
        return False
    kernel = effect.kernel.py_func
    position, velocity, entering = kernel.__code__.co_varnames[2:5]
    own = {position, entering} if effect.follows_command else {position, velocity, entering}
    read = ast.walk(ast.parse(textwrap.dedent(inspect.getsource(kernel))))
    return own.isdisjoint(node.id for node in read if isinstance(node, ast.Name))


def _call(number: int, slot: Slot, lanes: int, shared: Shared) -> str:
    """Return the case of an effect, whose rows are told by ``calls`` to a lane alone, and by numbers to several."""
    told = {index: repr(value) for place, index, value in shared if place == number}
    effect, alone = slot.effect, lanes == 1

    def row(name: str, first: int, index: int) -> str:
        return f"w[{name} + {index}]" if alone else f"w[{(first + index) * lanes} + i]"

    states = [row("state", slot.first_state, j) for j in range(len(effect.states))]
    entering = "w[u + i] - w[total + i]" if effect.port is Port.TRANSMISSION else "w[u + i]"
    moving = "w[COMMANDED_V + i]" if effect.follows_command else ("velocity" if alone else "w[v + i]")
    arguments = [*(["t", "h", "position"] if alone else ["w[T + i]", "h", "w[x + i]"]), moving, entering]
    arguments += [f"uniform[{'draw' if alone else slot.uniform}, i]"] if effect.random else []
    arguments += [told.get(j, row("flag", slot.flag, 1 + j)) for j in range(len(effect.parameters()))] + states
    targets = ["value", *(["steep"] if effect.port.is_force else []), *(f"z_{j}" for j in range(len(states)))]
    result = ", ".join(targets) if len(targets) > 1 else "(value,)"
    lines = [f"{result} = kernel_{number}({', '.join(arguments)})"]
    if not alone:
        lines.append(f"on = {row('flag', slot.flag, 0)} > 0.5")

    def put(place: str, value: str, plus: str = "") -> None:
        otherwise = "" if alone else f" if on else {'0.0' if plus else place}"
        lines.append(f"{place} {plus}= {value}{otherwise}")

    if effect.port.is_force:
        put("w[force + i]", "value", "+")
        put("w[slope + i]", "steep", "+")
        if effect.adds_to_disturbance():
            put("w[PROCESS + i]", "value", "+")
    elif effect.port is Port.TRANSMISSION:
        put("w[total + i]", "value", "+")
    else:
        put("w[u + i]", "value")
    for j, state in enumerate(states):
        put(state, f"z_{j}")
    if alone:
        return f"if case == {number}:\n" + textwrap.indent("\n".join(lines), 4 * " ")
    every = "for i in range(LANES):\n" + textwrap.indent("\n".join(lines), 4 * " ")
    if of_time_alone(effect):
        # Lanes of one machine and clock have the same force: it is computed once for all of them.
        rows = ["w[T + i]", *(a for a in arguments[5:] if a.startswith("w[")), *([moving] * effect.follows_command)]
        other = " | ".join(f"({row} != {_of_first_lane(row)})" for row in rows)
        # The second lane first: it tells machines that are drawn apart, and spares them the loop.
        count = f"others = 1 if {other.replace(' + i]', ' + 1]')} else 0\nif others == 0:\n"
        count += f"    for i in range(LANES):\n        others += 1 if {other} else 0\n"
        once = "\n".join([_of_first_lane(lines[0]), "for i in range(LANES):", *(f"    {line}" for line in lines[1:])])
        every = f"{count}if others == 0:\n{textwrap.indent(once, 4 * ' ')}\nelse:\n{textwrap.indent(every, 4 * ' ')}"
    return f"if case == {number}:\n{textwrap.indent(every, 4 * ' ')}"


def _of_first_lane(text: str) -> str:
    return text.replace(" + i]", "]")


def _port(place: int, cases: Sequence[str], lanes: int) -> str:
    """Return the function of a port."""
    port, arguments = list(PORT_ARGUMENTS.items())[place]
    told = "flag, state, draw = calls[n, 1], calls[n, 2], calls[n, 3]\ncase = calls[n, 0] if w[flag] > 0.5 else -1\n"
    body = (told if lanes == 1 else "case = calls[n, 0]\n") + "\nel".join(cases)
    read = "    t, position, velocity = w[T], w[x], w[v]\n" if lanes == 1 else ""
    return (
        f"@inlined\ndef {port.value}(w, calls, first_calls, h, x, v, {arguments}, uniform):\n{read}"
        f"    for n in range(first_calls[{place}], first_calls[{place + 1}]):\n" + textwrap.indent(body, 8 * " ") + "\n"
    )


def source(effects: Sequence[type[Effect]], lanes: int, shared: Shared = ()) -> str:
    """Return the text of the generated module, with a case for each of these effects."""
    constants = [f"{name} = {row * lanes}" for row, name in enumerate(layout.ROWS)]
    constants += [f"OUT_COLUMNS = {layout.OUT_COLUMNS}", f"NORMAL_COLUMNS = {layout.NORMAL_COLUMNS}"]
    cases: dict[Port, list[str]] = {port: [] for port in PORT_ARGUMENTS}
    for number, slot in enumerate(slots(tuple(effects))):
        effect = slot.effect
        effect.check_signature()
        constants.append(f"kernel_{number} = KERNELS[{number}]  # {effect.__module__}.{effect.__name__}")
        cases[effect.port].append(_call(number, slot, lanes, shared))
    names = ", ".join(effect.name for effect in effects) or "no effects"
    text = [_port(place, found, lanes) for place, found in enumerate(cases.values()) if found]
    for function in (integrator.propagate, integrator.measure_and_control, integrator.integrate_substep):
        text.append("@inlined\n" + inspect.getsource(function))
    text.append("@compiled\n" + inspect.getsource(integrator.advance))
    # Every statement takes its time to compile: calls of ports without effects, and the number of the only lane.
    empty = tuple(f"    {port.value}(" for port, found in cases.items() if not found)
    lines = [line for line in "\n\n".join(text).splitlines() if not line.startswith(empty)]
    body = "\n".join(lines)
    body = body.replace(" + i]", "]").replace(", i]", ", 0]") if lanes == 1 else body
    level = 1 if lanes == 1 else 2  # the second reads a row once where several expressions use it
    header = _HEADER.format(names=names, lanes=lanes, level=level, constants="\n".join(constants))
    return header + "\n\n" + body + "\n"


def load(text: str, effects: Sequence[type[Effect]]) -> ModuleType:
    """Return the generated module of this text, in which ``KERNELS`` are the kernels of ``effects``."""
    digest = hashlib.sha256(text.encode())
    for effect in effects:
        digest.update(closure_digest(effect.kernel).encode())
    name = f"stepper_{digest.hexdigest()[:24]}"
    path = cache_folder() / f"{name}.py"
    if not _holds(path, text):
        write_text(path, text)
    module = ModuleType(f"{GENERATED}{name}")
    module.__file__ = str(path)
    vars(module)["KERNELS"] = [_without_wrappers(effect.kernel) for effect in effects]
    sys.modules[module.__name__] = module
    # From the text, not from the folder: what others may have left there, compiled or not, is not run.
    exec(compile(text, path, "exec"), vars(module))
    return module


@lru_cache(maxsize=256)
def _without_wrappers(kernel: Any) -> Any:
    """Return a kernel that only compiled functions call: what Python would call takes as long to compile again."""
    options = {**kernel.targetoptions, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return followed(jit(**options)(kernel.py_func))


def _holds(path: Path, text: str) -> bool:
    """Return whether a file has this very text."""
    try:
        return path.read_bytes() == text.encode()
    except OSError:
        return False


@dataclass(frozen=True, kw_only=True, eq=False)
class Stepper:
    """The compiled ``advance`` of the integrator, and how the effects of a block are called in it.

    Attributes
    ----------
    advance : callable
    order : (n_effects,) array of int
        Effects by port and rank.
    table : (n_effects, 4) array of int
        In that order: case of the code, first row of parameters, first row of internal states, random number; rows
        times lanes.
    ports : (n_effects,) array of int
        In that order: place of the port.
    """

    advance: Callable[..., None]
    order: NDArray[np.int64]
    table: NDArray[np.int64]
    ports: NDArray[np.int64]

    def calls(self, active: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows of the table of active effects, and where those of each port begin."""
        on = active[self.order]
        counts = np.bincount(self.ports[on], minlength=len(PORT_ARGUMENTS))
        return self.table[on], np.concatenate(([0], np.cumsum(counts)))


@lru_cache(maxsize=64)
def compose(effects: tuple[type[Effect], ...], lanes: int, shared: Shared = ()) -> Stepper:
    """Return the stepper for blocks with these effects and this many lanes side by side.

    ``shared`` are parameters that have this value in every lane, whatever the blocks say; none for a lane alone.

    Raises
    ------
    SpecError
        If there are more than `MOST_EFFECTS`.
    """
    if len(effects) > MOST_EFFECTS:
        raise SpecError(f"effects: {len(effects)} on one axis; at most {MOST_EFFECTS} are simulated.")
    kinds: tuple[type[Effect], ...] = effects
    if lanes == 1:
        own = tuple(dict.fromkeys(effect.declared for effect in effects))
        kinds = core_effects() if set(own) <= set(core_effects()) else own
    cases = [kinds.index(effect.declared) for effect in effects] if lanes == 1 else range(len(effects))
    places, found = list(PORT_ARGUMENTS), slots(effects)
    keys = [(places.index(effect.port), effect.rank) for effect in effects]
    order = sorted(range(len(effects)), key=keys.__getitem__)
    table = [(cases[n], found[n].flag * lanes, found[n].first_state * lanes, found[n].uniform) for n in order]
    return Stepper(
        advance=_advance(kinds, lanes, shared),
        order=np.array(order, dtype=np.int64),
        table=np.array(table, dtype=np.int64).reshape(-1, 4),
        ports=np.array([keys[n][0] for n in order], dtype=np.int64),
    )


@lru_cache(maxsize=64)
def _advance(kinds: tuple[type[Effect], ...], lanes: int, shared: Shared) -> Callable[..., None]:
    advance: Callable[..., None] = load(source(kinds, lanes, shared), kinds).advance
    return advance
