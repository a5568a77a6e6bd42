"""Tangents of a simulated axis: the stepper and its kernels, differentiated in forward mode, a direction to each lane.

Nothing of the physics stands here: integrator and kernels are read, differentiated by `ForwardMode` and compiled.
"""

import ast
import inspect
import textwrap
from functools import lru_cache
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from fdbench.effects import Effect, Port, _derivatives, kernel
from fdbench.effects._derivatives import DERIVATIVES, STAIRCASES, straight_through
from fdbench.errors import PluginError
from fdbench.simulate import integrator, layout
from fdbench.simulate.axis import Axis
from fdbench.simulate.compose import Stepper, load, room_ahead, source, stepper
from fdbench.simulate.forward_mode import Called, ForwardMode, Moves
from fdbench.simulate.memory import aligned_zeros
from fdbench.simulate.ports import block_rows
from fdbench.simulate.random import CHUNK, RandomNumbers
from fdbench.simulate.system import FloatArray, Noise

LANES = 8  # as measured: most drives have so many settings, and wider ones are no faster
CONSTANT = (int, len, range)  # functions whose result does not move
READINGS = (Port.MOTOR_ENCODER, Port.TABLE_SCALE)
MOVED = ("x_m", "v_m", "x_t", "v_t", "force_m", "force_t")  # arguments of the integrator, beside the block
IN_STEPPER = {"abs": abs, "max": max, "min": min}


def tangent_kernel(effect: type[Effect]) -> Any:
    """Return the compiled kernel of an effect with tangents: behind each argument that moves, and behind each result.

    All arguments move but time, substep and a random number. An encoder that counts passes the tangent on as if it did
    not: that of a staircase is 0, and would open every loop that is closed over it.
    """
    return _differentiated(effect.kernel, _moves(effect), effect.port in READINGS)


def _moves(effect: type[Effect]) -> Moves:
    still = {0, 1, 5} if effect.random else {0, 1}
    return tuple(place not in still for place in range(len(effect.arguments())))


@lru_cache(maxsize=256)
def _differentiated(dispatcher: Any, moves: Moves, is_reading: bool) -> Any:
    function: FunctionType = dispatcher.py_func
    variables = inspect.getclosurevars(function)
    known = {**variables.builtins, **function.__globals__, **variables.nonlocals}
    space = dict(known)

    def called(name: str, moving: Moves) -> Called | None:
        plain = eval(name, known)
        if plain in CONSTANT or not any(moving):
            return None
        if plain in DERIVATIVES:
            moving = (True,) * len(moving)
            made = straight_through if is_reading and plain in STAIRCASES else DERIVATIVES[plain]
        elif isinstance(plain, Dispatcher):
            made = _differentiated(plain, moving, is_reading)
        else:
            raise PluginError(f"{function.__module__}: {name} in a kernel has no rule of differentiation.")
        new = f"tangent_of_{name.replace('.', '_')}_{''.join(str(int(moved)) for moved in moving)}"
        space[new] = made
        return Called(new, moving)

    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    text = ForwardMode(called, function.__module__).text(tree, moves)
    exec(compile(text, inspect.getfile(function), "exec"), space)
    return kernel(space[function.__name__])


def tangent_source(effects: tuple[type[Effect], ...]) -> str:
    """Return the text of the stepper whose blocks have, behind the rows of all values, those of their tangents."""
    tree = ast.parse(source(effects, LANES, once=False))
    inlined = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name != "compiled"]
    moves = {node.name: tuple(argument.arg in MOVED for argument in node.args.args) for node in inlined}
    moves |= {f"kernel_{number}": _moves(effect) for number, effect in enumerate(effects)}
    rules = {name: DERIVATIVES[function].py_func.__name__ for name, function in IN_STEPPER.items()}
    constant = [function.__name__ for function in CONSTANT]

    def called(name: str, moving: Moves) -> Called | None:
        if name in moves:
            return Called(name, moves[name])
        if name in constant or not any(moving):
            return None
        return Called(rules[name], (True,) * len(moving))

    mode, text = ForwardMode(called, integrator.__name__, block="w"), []
    for node in tree.body:
        decorators = [f"@{ast.unparse(decorator)}" for decorator in getattr(node, "decorator_list", ())]
        text += [*decorators, mode.text(node, moves[node.name])] if node in inlined else [ast.unparse(node)]
    head = f"from {_derivatives.__name__} import {', '.join(rules.values())}"
    return "\n".join([text[0], head, f"TANGENT = {block_rows(effects) * LANES}", *text[1:]]) + "\n"


@lru_cache(maxsize=64)
def compose_tangents(effects: tuple[type[Effect], ...]) -> Stepper:
    """Return the stepper of values and tangents for blocks with these effects."""
    made = load(tangent_source(effects), [tangent_kernel(effect) for effect in effects])
    return stepper(effects, LANES, range(len(effects)), made.advance)


def tangents(axis: Axis, directions: FloatArray, seed: int = 0) -> FloatArray:
    r"""Return the derivatives of what an axis logs by what it begins with, from its start to the end of its motion.

    .. math:: \dot w_{k+1} = \frac{\partial \Phi}{\partial w}(w_k)\, \dot w_k

    with the rows w of its block, values of the plant and states alike, and the stepper :math:`\Phi`. They are exact to
    rounding; at limits and reversals they are those of the branch that is taken. Source: as of `forward_mode`.

    Parameters
    ----------
    axis : Axis
        Of one lane, without noise; it stays where it is.
    directions : (n_rows, n_directions) array
        Derivatives :math:`\dot w_0` of the rows of `Axis.initial`.
    seed : int
        Of its random effects.

    Returns
    -------
    (n_samples, n_columns, n_directions) array
    """
    n_rows, n = directions.shape
    n_blocks = -(-n // LANES)
    n_lanes = n_blocks * LANES
    blocks = aligned_zeros(n_blocks, 2, n_rows, LANES)
    blocks[:, 0] = axis.initial[0]
    padded = np.hstack((directions, np.zeros((n_rows, n_lanes - n))))
    blocks[:, 1] = padded.reshape(n_rows, n_blocks, LANES).swapaxes(0, 1)
    kinds, clock = tuple(type(effect) for effect in axis.effects), (axis.timing.substeps, axis.timing.sampling_time_s)
    n_uniform = max(1, sum(kind.random for kind in kinds))
    numbers = RandomNumbers(axis._sources(Noise()), n_lanes, LANES, layout.NORMAL_COLUMNS, n_uniform)
    numbers.start([seed] * n_lanes, np.arange(n_lanes))
    made = compose_tangents(kinds)
    calls = made.calls(np.ones(len(kinds), dtype=np.bool_))
    logged = axis._pick[: len(axis.columns)] + n_rows
    settings = (*clock, *calls, room_ahead(len(calls[0]), clock[0]), axis.reference, logged)
    random = numbers.normal.reshape(n_blocks, CHUNK, -1), numbers.uniform
    rows = np.empty((axis.n_samples, len(logged), n_blocks, LANES))
    for first in range(0, axis.n_samples, CHUNK):
        numbers.refill()
        out = rows[first : first + CHUNK]
        made.advance(blocks.reshape(n_blocks, -1), 0, len(out), *settings, *random, out)
    return rows.reshape(axis.n_samples, len(logged), -1)[:, :, :n]
