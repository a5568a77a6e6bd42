"""Calls of the effects in a generated stepper: a function for each port, with a case for each effect."""

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from fdbench.effects import Effect, Port
from fdbench.simulate import layout
from fdbench.simulate.invariants import Parted, parted

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


@dataclass(frozen=True)
class Slot:
    """Where one effect lies in a block: its on-flag, parameters and internal states, and its random number.

    Behind the states lies what `parted` finds to be constant.
    """

    effect: type[Effect]
    flag: int
    first_state: int
    uniform: int

    @property
    def first_constant(self) -> int:
        """First row of what is computed once for many substeps."""
        return self.first_state + len(self.effect.states)

    def parameter(self, index: int) -> int:
        """Return the row of parameter ``index``."""
        return self.flag + 1 + index


@lru_cache(maxsize=256)
def slots(effects: tuple[type[Effect], ...]) -> tuple[Slot, ...]:
    """Lay out the effects behind the fixed rows of a block: flags and parameters first, then states and constants."""
    flags = np.cumsum([layout.FIRST_FREE_ROW, *(1 + len(effect.parameters()) for effect in effects)])
    states = np.cumsum([flags[-1], *(_changing_rows(effect) for effect in effects)])
    uniforms = np.cumsum([0, *(int(effect.random) for effect in effects)])
    return tuple(Slot(e, int(flags[n]), int(states[n]), int(uniforms[n])) for n, e in enumerate(effects))


@lru_cache(maxsize=256)
def block_rows(effects: Sequence[type[Effect]]) -> int:
    """Return the number of rows of a block."""
    return layout.FIRST_FREE_ROW + sum(1 + len(effect.parameters()) + _changing_rows(effect) for effect in effects)


def _changing_rows(effect: type[Effect]) -> int:
    """Return how many internal states and constants of many substeps an effect has."""
    parts = parted(effect)
    return len(effect.states) + (len(parts.names) if parts else 0)


@lru_cache(maxsize=256)
def of_time_alone(effect: type[Effect]) -> bool:
    """Return whether a force changes with time or command alone: its kernel reads nothing else of the axis."""
    if not effect.port.is_force or effect.states or effect.random:
        return False
    changing = {"t", "v"} if effect.follows_command else {"t"}
    return bool(arguments_read(effect) & changing) and arguments_read(effect) <= {"h", *changing}


@lru_cache(maxsize=256)
def arguments_read(effect: type[Effect]) -> frozenset[str]:
    """Return which of t, h, x, v and u the kernel reads."""
    read = ast.walk(ast.parse(textwrap.dedent(inspect.getsource(effect.kernel.py_func))))
    return frozenset(effect.arguments()[:5]) & {node.id for node in read if isinstance(node, ast.Name)}


def kernels(effects: Sequence[type[Effect]], lanes: int, *, once: bool = True) -> dict[str, Any]:
    """Return the compiled functions that the text of `ports` calls, by their names there."""
    found: dict[str, Any] = {}
    for number, effect in enumerate(effects):
        parts = _parts(effect, lanes, once=once)
        found |= {f"prepare_{number}": parts.prepare} if parts else {}
        found[f"kernel_{number}"] = parts.rest if parts else effect.kernel
    return found


def _parts(effect: type[Effect], lanes: int, *, once: bool) -> Parted | None:
    """Return the two parts of a kernel if several lanes call it in every substep."""
    return parted(effect) if once and lanes > 1 and not of_time_alone(effect) else None


def ports(effects: Sequence[type[Effect]], lanes: int, shared: Shared, *, once: bool = True) -> dict[str, str]:
    """Return the functions of ports that have effects, and of what is computed once: ``look_ahead`` and ``prepare``.

    ``shared`` are parameters that have this value in every lane, whatever the blocks say. ``once``: what lanes or
    substeps have alike may be computed once.
    """
    calls: dict[Port, list[_Call]] = {port: [] for port in PORT_ARGUMENTS}
    for number, slot in enumerate(slots(tuple(effects))):
        told = {index: repr(value) for place, index, value in shared if place == number}
        calls[slot.effect.port].append(_Call(number, slot, lanes, told, once))
    found = {port.value: _port(place, own, lanes) for place, (port, own) in enumerate(calls.items()) if own}
    every = [call for own in calls.values() for call in own]
    ahead, parts = [call for call in every if call.is_ahead], [call for call in every if call.parts]
    found |= {"look_ahead": _look_ahead(ahead)} if ahead else {}
    return found | ({"prepare": _prepare(parts)} if parts else {})


@dataclass(frozen=True)
class _Call:
    """One effect of the stepper, whose rows are told by ``calls`` to a lane alone, and by numbers to several."""

    number: int
    slot: Slot
    lanes: int
    told: Mapping[int, str]
    once: bool

    @property
    def is_ahead(self) -> bool:
        """Whether the force is computed before the substeps where lanes have it alike."""
        return self.once and self.lanes > 1 and of_time_alone(self.slot.effect)

    @property
    def parts(self) -> Parted | None:
        """The two parts of the kernel, if it is called so."""
        return _parts(self.slot.effect, self.lanes, once=self.once)

    @property
    def constants(self) -> list[str]:
        """What is handed from one part of the kernel to the other."""
        names = self.parts.names if self.parts else ()
        return [self._row("constant", self.slot.first_constant, j) for j in range(len(names))]

    @property
    def moving(self) -> str:
        """The velocity that the kernel is given."""
        if self.slot.effect.follows_command:
            return "w[COMMANDED_V + i]"
        return "velocity" if self.lanes == 1 else "w[v + i]"

    @property
    def parameters(self) -> list[str]:
        """Those that the kernel is given."""
        own = range(len(self.slot.effect.parameters()))
        return [self.told.get(j, self._row("flag", self.slot.flag, 1 + j)) for j in own]

    def _row(self, name: str, first: int, index: int) -> str:
        return f"w[{name} + {index}]" if self.lanes == 1 else f"w[{(first + index) * self.lanes} + i]"

    def case(self) -> list[str]:
        """Return the lines that call the kernel and take in what it returns."""
        effect, alone = self.slot.effect, self.lanes == 1
        states = [self._row("state", self.slot.first_state, j) for j in range(len(effect.states))]
        entering = "w[u + i] - w[total + i]" if effect.port is Port.TRANSMISSION else "w[u + i]"
        arguments = [*(["t", "h", "position"] if alone else ["w[T + i]", "h", "w[x + i]"]), self.moving, entering]
        arguments += [f"uniform[{'draw' if alone else self.slot.uniform}, i]"] if effect.random else []
        targets = ["value", *(["steep"] if effect.port.is_force else []), *(f"z_{j}" for j in range(len(states)))]
        result = ", ".join(targets) if len(targets) > 1 else "(value,)"
        kernel = (
            f"{result} = kernel_{self.number}({', '.join([*arguments, *self.parameters, *self.constants, *states])})"
        )
        taken = [] if alone else [f"on = {self._row('flag', self.slot.flag, 0)} > 0.5"]

        def put(place: str, value: str, plus: str = "") -> None:
            otherwise = "" if alone else f" if on else {'0.0' if plus else place}"
            taken.append(f"{place} {plus}= {value}{otherwise}")

        if effect.port.is_force:
            put("total_force" if alone else "w[force + i]", "value", "+")
            put("total_slope" if alone else "w[slope + i]", "steep", "+")
            if effect.adds_to_disturbance():
                put("w[PROCESS + i]", "value", "+")
        elif effect.port is Port.TRANSMISSION:
            put("w[total + i]", "value", "+")
        else:
            put("w[u + i]", "value")
        for j, state in enumerate(states):
            put(state, f"z_{j}")
        if alone:
            return [kernel, *taken]
        every = _each("for i in range(LANES):", [kernel, *taken])
        if not self.is_ahead:
            return every
        known = ["value, steep = ahead[n, 0], ahead[n, 1]", *_each("for i in range(LANES):", taken)]
        return [*_each("if ahead[n, 2] > 0.5:", known), *_each("else:", every)]

    def prepare(self) -> list[str]:
        """Return the lines that compute what all substeps have alike."""
        computed = f"{', '.join(self.constants)}, = prepare_{self.number}({', '.join(['h', *self.parameters])})"
        return _each("for i in range(LANES):", [computed])

    def look_ahead(self) -> list[str]:
        """Return the lines that compute the force of a whole sample, if all lanes have the same clock and rows."""
        follows = self.slot.effect.follows_command
        rows = ["w[INDEX + i]", *(text for text in self.parameters if text.startswith("w["))]
        rows += [self.moving] * follows
        other = " | ".join(f"({row} != {_of_first_lane(row)})" for row in rows)
        values = [_of_first_lane(text) for text in [self.moving if follows else "0.0", "0.0", *self.parameters]]
        names = [f"p_{j}" for j in range(len(values))]
        kernel = f"ahead[n, 0, step], ahead[n, 1, step] = kernel_{self.number}(t, h, 0.0, {', '.join(names)})"
        compute = [
            f"start = {_of_first_lane('w[INDEX + i]')} * period",
            *(f"{name} = {value}" for name, value in zip(names, values, strict=True)),
            *_each("for step in range(n_ahead):", ["t = start + (step + 0.5) * h", kernel]),
        ]
        return [
            # The second lane first: it tells machines that are drawn apart, and spares them the loop.
            f"others = 1 if {other.replace(' + i]', ' + 1]')} else 0",
            *_each("if others == 0:", _each("for i in range(LANES):", [f"others += 1 if {other} else 0"])),
            "ahead[n, 2, :] = 0.0 if others > 0 else 1.0",
            *_each("if others == 0:", compute),
        ]


def _each(head: str, lines: Sequence[str]) -> list[str]:
    """Return lines under a head."""
    return [head, *(f"    {line}" for line in lines)]


def _of_first_lane(text: str) -> str:
    return text.replace(" + i]", "]")


def _cases(found: Sequence[tuple[int, list[str]]]) -> str:
    """Return the lines of the case that ``case`` names."""
    texts = ["\n".join(_each(f"if case == {number}:", lines)) for number, lines in found]
    return textwrap.indent("\nel".join(texts), 8 * " ") + "\n"


def _port(place: int, calls: Sequence[_Call], lanes: int) -> str:
    """Return the function of a port."""
    port, arguments = list(PORT_ARGUMENTS.items())[place]
    arguments += ", ahead" if port.is_force else ""
    head = f"@inlined\ndef {port.value}(w, calls, first_calls, h, x, v, {arguments}, uniform):\n"
    loop = f"    for n in range(first_calls[{place}], first_calls[{place + 1}]):\n"
    cases = _cases([(call.number, call.case()) for call in calls])
    if lanes > 1:
        return f"{head}{loop}        case = calls[n, 0]\n{cases}"
    read = "    t, position, velocity = w[T], w[x], w[v]\n"
    told = "        flag, state, draw = calls[n, 1], calls[n, 2], calls[n, 3]\n"
    summed = written = ""
    if port.is_force:  # sums in registers: each effect would wait until what the one before has stored is read
        summed = "    total_force, total_slope = w[force], w[slope]\n"
        written = "    w[force], w[slope] = total_force, total_slope\n"
    return f"{head}{read}{summed}{loop}{told}        case = calls[n, 0] if w[flag] > 0.5 else -1\n{cases}{written}"


def _look_ahead(calls: Sequence[_Call]) -> str:
    """Return the function that computes forces of time alone before the substeps of a sample."""
    return (
        "@inlined\ndef look_ahead(w, calls, period, h, ahead):\n    n_ahead = ahead.shape[2]\n"
        "    for n in range(calls.shape[0]):\n        case = calls[n, 0]\n"
        + _cases([(call.number, call.look_ahead()) for call in calls])
    )


def _prepare(calls: Sequence[_Call]) -> str:
    """Return the function that computes what all substeps have alike."""
    return (
        "@inlined\ndef prepare(w, calls, h):\n    for n in range(calls.shape[0]):\n        case = calls[n, 0]\n"
        + _cases([(call.number, call.prepare()) for call in calls])
    )
