"""Stepper of a servo stage: exact linear response to a smooth command, effects as forces on the table.

This file is a template. `compose` writes its functions into a generated module, in which ``table_force`` calls the
kernels of one plant's effects; see `fdbench.simulate.compose`.
"""

# mypy: ignore-errors
# ruff: noqa: F821 - table_force is defined in the generated module

import inspect
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from fdbench.effects import Effect
from fdbench.simulate.compose import load

_HEADER = '''"""Generated stepper of a servo stage with {names}."""

import numpy as np
from numba import njit

from fdbench.compilation import kept


def compiled(function):
    return kept(njit(error_model="numpy")(function))


inlined = njit(error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, no_rewrites=True)
{kernels}


@inlined
def table_force(t, h, x, v, commanded_v, u, parameters, states):
    force = slope = process = 0.0
{calls}
    return force, slope, process
'''


def product(row, z, n):
    """Return the product of the first n entries of a row and a state."""
    total = 0.0
    for i in range(n):
        total += row[i] * z[i]
    return total


def copy(values, target, n):
    """Copy n values. An assignment to a slice would be compiled with the text of an error of shapes, for seconds."""
    for i in range(n):
        target[i] = values[i]


def parabola(z, place, force, first, second, s, h):
    """Write value, slope and curvature of the force at s substeps after ``force``, from its backward differences."""
    z[place] = force + s * (first + 0.5 * (s + 1.0) * second)
    z[place + 1] = (first + (s + 0.5) * second) / h
    z[place + 2] = second / h**2


def advance(
    full, half, output, table, mobility, limits, deviation, reference, period, substeps, parameters,
    q, forces, states, count, diverged, action, normal, first_normal, out,
):  # fmt: skip
    r"""Advance every lane by ``len(out)`` samples; lane by lane, so that each has the bits of a single one.

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
    full, half : (n_axes, n, n + 7) arrays
        Exact flow over a substep and half of it, from q, from u and its three derivatives, from f and its two.
    output : (n_axes, n) array
        Position from q.
    table : (n_axes, 3, n + 2) array
        Position, velocity and servo force of the table from q, u and the derivative of u.
    mobility : (n_axes,) array
        Loss of the table's velocity at half a substep for one newton, m/(N s).
    limits, deviation : (2,), (n_axes,) arrays
        Travel (m) and velocity (m/s) of the table; standard deviation of the reading (m).
    reference : (n_reference, 3 n_axes) array
    parameters : (n_parameters,) array
        Those of all effects.
    q, forces, states, count, diverged : (n_lanes, n_axes, n), (n_lanes, n_axes, 4), (n_lanes, n_axes, n_states),
    (n_lanes,), (n_lanes,) arrays, changed in place
        ``forces`` are the last three and the weight of their differences.
    action : (n_axes, n_lanes) array
        Added to the commanded positions, m.
    normal : (n_lanes, n_random, n_axes) array
        Standard normal numbers, from ``first_normal`` on.
    out : (n_samples, 4 n_axes + 1, n_lanes) array, written
        Reference position and velocity, and reading, for each axis; mean process force of each axis; diverged.
    """
    n_axes, n, width = full.shape
    h = period / substeps
    z, middle = np.zeros(width), np.zeros(n + 2)
    for lane in range(count.size):
        for k in range(out.shape[0]):
            row = count[lane]
            after = min(row + 1, len(reference) - 1)
            for axis in range(n_axes):
                f = forces[lane, axis]
                v_0, v_1 = reference[row, 3 * axis + 1], reference[after, 3 * axis + 1]
                x_0 = reference[row, 3 * axis] + action[axis, lane]
                mean = (reference[after, 3 * axis] - reference[row, 3 * axis]) / period
                c_2 = (3.0 * mean - 2.0 * v_0 - v_1) / period
                c_3 = (v_0 + v_1 - 2.0 * mean) / period**2
                copy(q[lane, axis], z, n)
                z[n] = x_0
                z[n + 1] = v_0
                position = product(output[axis], z, n)
                velocity = product(table[axis, 1], z, n + 2)
                if not (abs(position) <= limits[0] and abs(velocity) <= limits[1]):
                    diverged[lane] = True
                out[k, 3 * axis, lane] = reference[row, 3 * axis]
                out[k, 3 * axis + 1, lane] = v_0
                out[k, 3 * axis + 2, lane] = position + deviation[axis] * normal[lane, first_normal + k, axis]
                process_sum = 0.0
                for step in range(substeps):
                    tau = step * h
                    z[n] = x_0 + tau * (v_0 + tau * (c_2 + tau * c_3))
                    z[n + 1] = v_0 + tau * (2.0 * c_2 + 3.0 * tau * c_3)
                    z[n + 2] = 2.0 * c_2 + 6.0 * tau * c_3
                    z[n + 3] = 6.0 * c_3
                    first, second = f[3] * (f[0] - f[1]), f[3] * (f[0] - 2.0 * f[1] + f[2])
                    ahead = f[0] + first + second
                    parabola(z, n + 4, f[0], first, second, 0.5, h)
                    for i in range(n):
                        middle[i] = product(half[axis, i], z, width)
                    tau += 0.5 * h
                    middle[n] = x_0 + tau * (v_0 + tau * (c_2 + tau * c_3))
                    middle[n + 1] = v_0 + tau * (2.0 * c_2 + 3.0 * tau * c_3)
                    x = product(table[axis, 0], middle, n + 2)
                    v = product(table[axis, 1], middle, n + 2)
                    u = product(table[axis, 2], middle, n + 2)
                    t = row * period + tau
                    force, slope, process = table_force(t, h, x, v, middle[n + 1], u, parameters, states[lane, axis])
                    stiffness = slope * mobility[axis]
                    f[2], f[1] = f[1], f[0]
                    f[0] = ahead + (force - ahead) / (1.0 + stiffness)
                    f[3] = 1.0 / (1.0 + 16.0 * stiffness**2)
                    first, second = f[3] * (f[0] - f[1]), f[3] * (f[0] - 2.0 * f[1] + f[2])
                    parabola(z, n + 4, f[0], first, second, -0.5, h)
                    for i in range(n):
                        middle[i] = product(full[axis, i], z, width)
                    copy(middle, z, n)
                    process_sum += process
                copy(z, q[lane, axis], n)
                out[k, 3 * n_axes + axis, lane] = process_sum / substeps
            out[k, 4 * n_axes, lane] = 1.0 if diverged[lane] else 0.0
            count[lane] += 1


def _call(number: int, effect: type[Effect], parameter: int, state: int) -> str:
    places = range(parameter, parameter + len(effect.parameters()))
    values = [f"parameters[{place}]" for place in places]
    internal = [f"states[{place}]" for place in range(state, state + len(effect.states))]
    results = ", ".join(["value", "steep", *internal])
    velocity = "commanded_v" if effect.follows_command else "v"
    lines = [f"{results} = kernel_{number}({', '.join(['t', 'h', 'x', velocity, 'u', *values, *internal])})"]
    lines += ["force += value", "slope += steep"]
    lines += ["process += value"] if effect.disturbance else []
    return "\n".join(f"    {line}" for line in lines)


@lru_cache(maxsize=64)
def compose(effects: tuple[type[Effect], ...]) -> Callable[..., None]:
    """Return the compiled `advance` for forces on the table of these kinds."""
    calls, parameter, state = [], 0, 0
    for number, effect in enumerate(effects):
        effect.check_signature()
        calls.append(_call(number, effect, parameter, state))
        parameter += len(effect.parameters())
        state += len(effect.states)
    header = _HEADER.format(
        names=", ".join(effect.name for effect in effects) or "no effects",
        kernels="\n".join(f"kernel_{number} = KERNELS[{number}]" for number in range(len(effects))),
        calls="\n".join(calls) or "    pass",
    )
    functions = [f"@inlined\n{inspect.getsource(function)}" for function in (product, copy, parabola)]
    return load("\n\n".join([header, *functions, f"@compiled\n{inspect.getsource(advance)}"]), effects).advance
