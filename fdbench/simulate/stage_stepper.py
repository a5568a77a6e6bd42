"""Stepper of a servo stage: exact linear response to a smooth command, effects as forces on the table.

This file is a template. `compose` writes its functions into a generated module that defines the rows and LANES, in
which ``table_force`` calls the kernels of one plant's effects, and in which names in capitals such as NEXT_0 stand for
sums over those entries of the stage's matrices that are not zero; see `fdbench.simulate.compose`.
"""

# mypy: ignore-errors
# ruff: noqa: B018, F821, F841, RUF059 - rows, sums and table_force are defined in the generated module

import inspect
import re
from collections.abc import Callable
from functools import lru_cache

from fdbench.effects import Effect
from fdbench.simulate.compose import load
from fdbench.simulate.ports import arguments_read

# One axis of a block of lanes: last three forces and the weight of their differences, sample number, flag, action,
# displacement of the motion, command of the sample, scratch of a substep. Behind them the states of the response and
# those of the effects.
ROWS = (
    *("FORCE_0", "FORCE_1", "FORCE_2", "WEIGHT", "INDEX", "DIVERGED", "ACTION", "DISPLACEMENT"),
    *("X_0", "V_0", "C_2", "C_3", "T", "X", "V", "COMMANDED_V", "U", "AHEAD", "FORCE", "SLOPE", "PROCESS"),
    "PROCESS_SUM",
)

_HEADER = '''"""Generated stepper of a servo stage with {names}, {lanes} lane(s) side by side."""

from numba import njit

from fdbench.compilation import kept, optimised


def compiled(function):
    return optimised(kept(njit(error_model="numpy", _nrt=False)(function)), {level}, {interleaved})


lean = dict(_nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)  # counts no references
inlined = njit(error_model="numpy", forceinline=True, **lean)
LANES = {lanes}
{constants}
'''

Pattern = tuple[tuple[str, tuple[str, ...]], ...]


def command(tau, x_0, v_0, c_2, c_3):
    """Return value and first three derivatives of the cubic through the commanded positions and velocities."""
    return (
        x_0 + tau * (v_0 + tau * (c_2 + tau * c_3)),
        v_0 + tau * (2.0 * c_2 + 3.0 * tau * c_3),
        2.0 * c_2 + 6.0 * tau * c_3,
        6.0 * c_3,
    )


def parabola(force, first, second, s, h):
    """Return value, slope and curvature of the force at s substeps after ``force``, from its backward differences."""
    return force + s * (first + 0.5 * (s + 1.0) * second), (first + (s + 0.5) * second) / h, second / h**2


def cubic(reference, row, axis, displacement, period):
    """Return commanded position and velocity of a sample, and the coefficients of the cubic that leads to the next."""
    after = min(row + 1, len(reference) - 1)
    v_0, v_1 = reference[row, 3 * axis + 1], reference[after, 3 * axis + 1]
    x = reference[row, 3 * axis] + displacement
    mean = (reference[after, 3 * axis] + displacement - x) / period
    return x, v_0, (3.0 * mean - 2.0 * v_0 - v_1) / period, (v_0 + v_1 - 2.0 * mean) / period**2


def measure(w, c, axis, period, limits, deviation, reference, normal, block, out):
    """Log one row of an axis, fit the coming command, and return whether lanes have it alike but for actions."""
    others = 0
    for i in range(LANES):
        others += 1 if w[INDEX + i] != w[INDEX] or w[DISPLACEMENT + i] != w[DISPLACEMENT] else 0
    if others == 0:  # lanes of one clock and start have one command
        x, v, second, third = cubic(reference, int(w[INDEX]), axis, w[DISPLACEMENT], period)
        for i in range(LANES):
            w[X_0 + i], w[V_0 + i], w[C_2 + i], w[C_3 + i] = x + w[ACTION + i], v, second, third
            out[3 * axis, block, i], out[3 * axis + 1, block, i] = x, v
    else:
        for i in range(LANES):
            x, v, second, third = cubic(reference, int(w[INDEX + i]), axis, w[DISPLACEMENT + i], period)
            w[X_0 + i], w[V_0 + i], w[C_2 + i], w[C_3 + i] = x + w[ACTION + i], v, second, third
            out[3 * axis, block, i], out[3 * axis + 1, block, i] = x, v
    for i in range(LANES):
        w[PROCESS_SUM + i] = 0.0
        u_0, u_1 = w[X_0 + i], w[V_0 + i]
        position, velocity = POSITION, VELOCITY
        inside = abs(position) <= limits[0] and abs(velocity) <= limits[1]
        w[DIVERGED + i] = w[DIVERGED + i] if inside else 1.0
        out[3 * axis + 2, block, i] = position + deviation[axis] * normal[axis, i]
    return others == 0


def look_ahead(w, c, period, h, parameters, ahead):
    """Compute the forces of a sample that follow from time and velocity, where lanes have both alike."""
    for step in range(ahead.shape[2]):
        middle = step * h + 0.5 * h
        _, v_0, _, _ = command(middle, w[X_0], w[V_0], w[C_2], w[C_3])
        t = w[INDEX] * period + middle
        KNOWN_FORCES


def predict(w, c, period, tau, h):
    """Extrapolate the force to the middle of a substep, and find table, command and time there."""
    for i in range(LANES):
        u_0, u_1, u_2, u_3 = command(tau, w[X_0 + i], w[V_0 + i], w[C_2 + i], w[C_3 + i])
        first = w[WEIGHT + i] * (w[FORCE_0 + i] - w[FORCE_1 + i])
        second = w[WEIGHT + i] * (w[FORCE_0 + i] - 2.0 * w[FORCE_1 + i] + w[FORCE_2 + i])
        f_0, f_1, f_2 = parabola(w[FORCE_0 + i], first, second, 0.5, h)
        x_0, v_0, _, _ = command(tau + 0.5 * h, w[X_0 + i], w[V_0 + i], w[C_2 + i], w[C_3 + i])
        w[X + i] = MIDDLE_X
        w[V + i] = MIDDLE_V
        w[U + i] = MIDDLE_U
        w[COMMANDED_V + i] = v_0
        w[T + i] = w[INDEX + i] * period + (tau + 0.5 * h)
        w[AHEAD + i] = w[FORCE_0 + i] + first + second
        w[FORCE + i] = 0.0
        w[SLOPE + i] = 0.0
        w[PROCESS + i] = 0.0


def correct(w, c, tau, h):
    """Advance the state over a substep under the force that the effects have at its middle."""
    for i in range(LANES):
        stiffness = STIFFNESS
        f_1, f_2 = w[FORCE_0 + i], w[FORCE_1 + i]
        force = w[AHEAD + i] + (w[FORCE + i] - w[AHEAD + i]) / (1.0 + stiffness)
        weight = 1.0 / (1.0 + 16.0 * (stiffness * stiffness))
        w[FORCE_0 + i], w[FORCE_1 + i], w[FORCE_2 + i], w[WEIGHT + i] = force, f_1, f_2, weight
        f_0, f_1, f_2 = parabola(force, weight * (force - f_1), weight * (force - 2.0 * f_1 + f_2), -0.5, h)
        u_0, u_1, u_2, u_3 = command(tau, w[X_0 + i], w[V_0 + i], w[C_2 + i], w[C_3 + i])
        NEXT_STATE
        w[PROCESS_SUM + i] += w[PROCESS + i]


def advance(
    blocks, first, period, substeps, coefficients, limits, deviation, reference, parameters, ahead, normal, out
):
    r"""Advance every lane of every block by the samples of ``out``.

    Between samples the command u is the cubic through its positions and velocities. Over a substep h the force f is the
    parabola through the middles of the last three substeps: it is extrapolated to the middle of the new one, where the
    effects are evaluated, and the state then advances exactly with the parabola that holds the new force,

    .. math::
        s_{1/2} = \Phi_{h/2} (q, u, f^*), \quad
        f = f^* + \frac{f(s_{1/2}) - f^*}{1 + \sigma}, \quad
        q^+ = \Phi_h (q, u, f), \qquad \sigma = S\, \partial v_{1/2} / \partial f

    with S the effects' slope. A stiff force is not extrapolated: its differences enter by 1 / (1 + 16 sigma^2).

    Parameters
    ----------
    blocks : (n_blocks, n_axes, n_rows * LANES) array, changed in place
    first : int
        Where the random numbers begin.
    period, substeps : float, int
        Sampling time, s; integration substeps in it.
    coefficients : (n_axes, n_coefficients) array
        Entries of the matrices in the order of the pattern.
    limits, deviation : (2,), (n_axes,) arrays
        Travel (m) and velocity (m/s) of the table; standard deviation of the reading (m).
    reference : (n_reference, 3 n_axes) array
    parameters : (n_parameters,) array
        Those of all effects.
    ahead : (n_effects, 2, substeps) array, written
        Force and slope of those effects that lanes may have alike.
    normal : (n_blocks, n_random, n_axes, LANES) array
        Standard normal numbers.
    out : (n_samples, 4 n_axes + 1, n_blocks, LANES) array, written
        Reference position and velocity, and reading, for each axis; mean process force of each axis; diverged.
    """
    n_axes = blocks.shape[1]
    h = period / substeps
    for block in range(blocks.shape[0]):
        for k in range(out.shape[0]):
            for i in range(LANES):
                out[k, 4 * n_axes, block, i] = 0.0
            for axis in range(n_axes):
                w, c = blocks[block, axis], coefficients[axis]
                gauss = normal[block, first + k]
                alike = measure(w, c, axis, period, limits, deviation, reference, gauss, block, out[k])
                if alike:
                    look_ahead(w, c, period, h, parameters, ahead)
                for step in range(substeps):
                    predict(w, c, period, step * h, h)
                    table_force(w, h, parameters, alike, ahead[:, :, step])
                    correct(w, c, step * h, h)
                for i in range(LANES):
                    w[INDEX + i] += 1.0
                    out[k, 3 * n_axes + axis, block, i] = w[PROCESS_SUM + i] / substeps
                    out[k, 4 * n_axes, block, i] = max(out[k, 4 * n_axes, block, i], w[DIVERGED + i])


def _call(number: int, effect: type[Effect], parameter: int, state: int, lanes: int, known: bool) -> list[str]:
    """Return the loop over lanes that adds one effect; its internal states begin at row ``state``.

    One that is ``known`` ahead is not computed again where lanes are alike.
    """
    names = [f"p_{n}" for n in range(len(effect.parameters()))]
    internal = [f"w[{row * lanes} + i]" for row in range(state, state + len(effect.states))]
    velocity = "w[COMMANDED_V + i]" if effect.follows_command else "w[V + i]"
    given = ["w[T + i]", "h", "w[X + i]", velocity, "w[U + i]", *names, *internal]
    found = ["value", "steep", *(f"z_{n}" for n in range(len(internal)))]
    added = [
        "w[FORCE + i] += value",
        "w[SLOPE + i] += steep",
        *(["w[PROCESS + i] += value"] if effect.adds_to_disturbance() else []),
        *(f"{place} = {name}" for place, name in zip(internal, found[2:], strict=True)),
    ]
    lines = _each("for i in range(LANES):", [f"{', '.join(found)} = kernel_{number}({', '.join(given)})", *added])
    if known:
        alike = [f"value, steep = ahead[{number}, 0], ahead[{number}, 1]", *_each("for i in range(LANES):", added)]
        lines = [*_each("if alike:", alike), *_each("else:", lines)]
    return [*(f"{name} = parameters[{parameter + n}]" for n, name in enumerate(names)), *lines]


def _known_force(number: int, effect: type[Effect], parameter: int) -> str:
    """Return the line that computes one effect ahead."""
    values = [f"parameters[{place}]" for place in range(parameter, parameter + len(effect.parameters()))]
    given = ["t", "h", "0.0", "v_0" if effect.follows_command else "MIDDLE_V", "0.0", *values]
    return f"ahead[{number}, 0, step], ahead[{number}, 1, step] = kernel_{number}({', '.join(given)})"


def _each(head: str, lines: list[str]) -> list[str]:
    """Return lines under a head."""
    return [head, *(f"    {line}" for line in lines)]


def _without(text: str, beginnings: tuple[str, ...]) -> str:
    """Return the lines of a text that begin otherwise."""
    return "\n".join(line for line in text.split("\n") if not line.lstrip().startswith(beginnings))


def _sums(text: str, pattern: Pattern) -> str:
    """Return the text of a function with the sums in place of their names, and their coefficients read before."""
    read, place = [], 0
    for name, columns in pattern:
        terms = [f"c_{place + n} * {column}" for n, column in enumerate(columns)]
        text, found = re.subn(rf"\b{name}\b", " + ".join(terms) or "0.0", text)
        read += [f"    c_{n} = c[{n}]" for n in range(place, place + len(columns)) if found]
        place += len(columns)
    head, body = text.split('"""\n', 1)
    return "\n".join([f'{head}"""', *read, body])


@lru_cache(maxsize=64)
def compose(effects: tuple[type[Effect], ...], pattern: Pattern, n_states: int, lanes: int) -> Callable[..., None]:
    """Return the compiled `advance` for forces on the table of these kinds.

    Parameters
    ----------
    effects : tuple of Effect classes
    pattern : tuple of pairs of str and tuple of str
        Each sum, and what its coefficients that are not zero are multiplied by.
    n_states, lanes : int
        States of an axis' response; lanes side by side.
    """
    rows = [*ROWS, *(f"Q_{n}" for n in range(n_states))]
    constants = [f"{name} = {row * lanes}" for row, name in enumerate(rows)]
    sums = dict(pattern)
    calls, known_forces, parameter, state = [], [], 0, len(rows)
    for number, effect in enumerate(effects):
        effect.check_signature()
        constants.append(f"kernel_{number} = KERNELS[{number}]")
        commanded = effect.follows_command or sums["MIDDLE_V"] == ("v_0",)
        told = {"t", "h", "v"} if commanded else {"t", "h"}
        known = lanes > 1 and arguments_read(effect) <= told and not effect.states
        calls += _call(number, effect, parameter, state, lanes, known)
        known_forces += [_known_force(number, effect, parameter)] * known
        parameter += len(effect.parameters())
        state += len(effect.states)
    names = ", ".join(effect.name for effect in effects) or "no effects"
    after = [f"z_{n} = NEXT_{n}" for n in range(n_states)] + [f"w[Q_{n} + i] = z_{n}" for n in range(n_states)]
    # A row that nothing reads is not computed: each takes as many products as there are states and inputs.
    read = frozenset[str]().union(*map(arguments_read, effects)) | ({"slope"} if sums["STIFFNESS"] else set())
    unread = tuple(f"w[{name.upper()} + i] " for name in ("t", "x", "u", "slope") if name not in read)
    text = [f"@inlined\n{inspect.getsource(function)}" for function in (command, parabola, cubic)]
    for function in (measure, look_ahead, predict, correct):
        source = inspect.getsource(function).replace("NEXT_STATE", "\n        ".join(after))
        source = source.replace("KNOWN_FORCES", "\n        ".join(known_forces))
        text.append("@inlined\n" + _sums(_without(source, unread), pattern))
    force = _each("def table_force(w, h, parameters, alike, ahead):", [*calls, "return"])
    text.append(_without("\n".join(["@inlined", *force]), unread))
    text.append(f"@compiled\n{inspect.getsource(advance)}")
    # As measured: level 2 is faster for lanes, level 3 for one, and more loops at once have too few registers.
    level, interleaved = (3, 0) if lanes == 1 else (2, 2)
    settings = {"level": level, "interleaved": interleaved, "constants": "\n".join(constants)}
    header = _HEADER.format(names=names, lanes=lanes, **settings)
    return load("\n\n".join([header, *text]), [effect.kernel for effect in effects]).advance
