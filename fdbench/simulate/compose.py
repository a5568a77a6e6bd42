"""Compose a stepper: the integrator's source with the kernels of some effects, as a generated module.

The module lies in the user's cache folder under a name that is the digest of its own text and of everything that its
kernels reach. Editing any of that gives a new file, so stale machine code cannot answer for it.

Which effects act is told to the machine code in a table of calls. A lane alone is simulated by one stepper of all
effects of this package, whatever it has of them and however often: rows of parameters are in that table too. Lanes side
by side run as vectors where the rows are known to the compiler, so their stepper has a case for each effect of theirs.
"""

import hashlib
import inspect
import os
import stat
import sys
import tempfile
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
from fdbench.effects import Effect
from fdbench.effects import effects as registry
from fdbench.errors import FdbenchError, SpecError
from fdbench.files import write_text
from fdbench.simulate import integrator, layout
from fdbench.simulate.ports import PORT_ARGUMENTS, Shared, kernels, ports, slots

GENERATED = "fdbench_generated."  # before the names of modules

_HEADER = '''"""Generated stepper for {names}, {lanes} lane(s) side by side."""

from numba import njit

from fdbench.compilation import kept, optimised


def compiled(function):
    return optimised(kept(njit(error_model="numpy", nogil=True)(function)), {level}, {interleaved})


inlined = njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
LANES = {lanes}
{constants}
'''

MOST_EFFECTS = 64  # on one axis


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


@lru_cache(maxsize=1)
def core_effects() -> tuple[type[Effect], ...]:
    """Return the effects of this package, in order of name."""
    modules = registry.modules()
    return tuple(registry.get(name) for name, module in modules.items() if module == f"fdbench.effects.{name}")


def source(effects: Sequence[type[Effect]], lanes: int, shared: Shared = (), *, once: bool = True) -> str:
    """Return the text of the generated module, with a case for each of these effects.

    ``once``: what lanes or substeps have alike may be computed once.
    """
    constants = [f"{name} = {row * lanes}" for row, name in enumerate(layout.ROWS)]
    constants += [f"OUT_COLUMNS = {layout.OUT_COLUMNS}", f"NORMAL_COLUMNS = {layout.NORMAL_COLUMNS}"]
    for number, effect in enumerate(effects):
        effect.check_signature()
        constants.append(f"# {number}: {effect.__module__}.{effect.__name__}")
    constants += [f"{name} = KERNELS[{place}]" for place, name in enumerate(kernels(effects, lanes, once=once))]
    names = ", ".join(effect.name for effect in effects) or "no effects"
    called = ports(effects, lanes, shared, once=once)
    text = list(called.values())
    for function in (integrator.propagate, integrator.measure_and_control, integrator.integrate_substep):
        text.append("@inlined\n" + inspect.getsource(function))
    text.append("@compiled\n" + inspect.getsource(integrator.advance))
    # Every statement takes its time to compile: calls of ports without effects, and the number of the only lane.
    every = *(port.value for port in PORT_ARGUMENTS), "look_ahead", "prepare"
    empty = tuple(f"{name}(" for name in every if name not in called)
    lines = [line for line in "\n\n".join(text).splitlines() if not line.lstrip().startswith(empty)]
    body = "\n".join(lines)
    body = body.replace(" + i]", "]").replace(", i]", ", 0]") if lanes == 1 else body
    # Level 2 reads a row once where several expressions use it; friction waits for chains of divisions.
    level, interleaved = (1, 0) if lanes == 1 else (2, 4)
    settings = {"level": level, "interleaved": interleaved, "constants": "\n".join(constants)}
    header = _HEADER.format(names=names, lanes=lanes, **settings)
    return header + "\n\n" + body + "\n"


def load(text: str, functions: Sequence[Any]) -> ModuleType:
    """Return the generated module of this text, in which ``KERNELS`` are these compiled functions."""
    digest = hashlib.sha256(text.encode())
    for kernel in functions:
        digest.update(closure_digest(kernel).encode())
    name = f"stepper_{digest.hexdigest()[:24]}"
    path = cache_folder() / f"{name}.py"
    if not _holds(path, text):
        write_text(path, text)
    module = ModuleType(f"{GENERATED}{name}")
    module.__file__ = str(path)
    vars(module)["KERNELS"] = [_without_wrappers(kernel) for kernel in functions]
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


def room_ahead(n_calls: int, substeps: int) -> NDArray[np.float64]:
    """Return the array of a stepper for forces of time alone, with whole vectors of 8 substeps."""
    return np.zeros((n_calls, 3, -(-substeps // 8) * 8))


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
    return stepper(effects, lanes, cases, _advance(kinds, lanes, shared))


def stepper(effects: Sequence[type[Effect]], lanes: int, cases: Sequence[int], advance: Callable[..., None]) -> Stepper:
    """Return the stepper of an ``advance`` that has each of these effects under its case."""
    places, found = list(PORT_ARGUMENTS), slots(tuple(effects))
    keys = [(places.index(effect.port), effect.rank) for effect in effects]
    order = sorted(range(len(effects)), key=keys.__getitem__)
    table = [(cases[n], found[n].flag * lanes, found[n].first_state * lanes, found[n].uniform) for n in order]
    return Stepper(
        advance=advance,
        order=np.array(order, dtype=np.int64),
        table=np.array(table, dtype=np.int64).reshape(-1, 4),
        ports=np.array([keys[n][0] for n in order], dtype=np.int64),
    )


@lru_cache(maxsize=64)
def _advance(kinds: tuple[type[Effect], ...], lanes: int, shared: Shared) -> Callable[..., None]:
    advance: Callable[..., None] = load(source(kinds, lanes, shared), [*kernels(kinds, lanes).values()]).advance
    return advance
