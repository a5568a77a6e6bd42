"""Random numbers of streams side by side in machine code, with the bits of NumPy's `Generator` on its PCG64.

NumPy goes from number to number through pointers, which takes several times as long as to draw one. Sources: O'Neill
(2014), PCG: a family of simple fast space-efficient statistically good algorithms for random number generation, Harvey
Mudd College HMC-CS-2014-0905; Marsaglia, Tsang (2000), The ziggurat method for generating random variables, J.
Statistical Software 5(8).
"""

import math
from decimal import Context, Decimal
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fdbench.compilation import kept

LEAN: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inlined, called = njit(**LEAN, forceinline=True), njit(**LEAN)  # that only compiled functions call

WORD, HALF = 2**64 - 1, 2**32 - 1
MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
MULTIPLIER_HIGH, MULTIPLIER_LOW = np.uint64(MULTIPLIER >> 64), np.uint64(MULTIPLIER & WORD)
UPPER, LOWER = np.uint64(MULTIPLIER >> 32 & HALF), np.uint64(MULTIPLIER & HALF)  # halves of the low word
MASK, MANTISSA = np.uint64(HALF), np.uint64(2**52 - 1)

LAYERS = 256
AREA = 0.0049286732339746519  # of a layer
TAIL = 3.6541528853610088  # where the tail begins
ROUNDED_UP = 38  # layer whose height in NumPy is not the nearest number but the next, 0.502 units in the last place off


@lru_cache(maxsize=1)
def ziggurat() -> NDArray[np.float64]:
    r"""Return layers under :math:`e^{-x^2/2}`, the lowest first, (3, 256): width, what of it is certain, height.

    .. math:: x_{255} = r, \quad x_i = \sqrt{-2 \ln (f_{i+1} + v / x_{i+1})}, \quad f_i = e^{-x_i^2 / 2}

    with the area v of a layer. The lowest has the width :math:`x_0 = v / f_{255}`, as if the tail lay in it. Widths are
    in units of :math:`2^{-52}`, what is certain, :math:`x_{i-1} / x_i`, too. Exponentials and logarithms are rounded
    correctly, and so the same on every machine.
    """
    digits = Context(prec=25)
    edges, heights = np.ones(LAYERS), np.ones(LAYERS)
    x = TAIL
    for i in reversed(range(1, LAYERS)):
        if i < LAYERS - 1:
            x = math.sqrt(-2.0 * float(digits.ln(Decimal(heights[i + 1] + AREA / x))))
        height = float(digits.exp(Decimal(-0.5 * x * x)))
        edges[i], heights[i] = x, math.nextafter(height, 1.0) if i == ROUNDED_UP else height
    edges[0] = AREA / heights[-1]
    within = np.concatenate(([TAIL, 0.0], edges[1:-1]))
    return np.stack((edges / 2.0**52, np.rint(within / edges * 2.0**52), heights))


def words(generator: np.random.Generator) -> list[int]:
    """Return state and increment of a generator on PCG64, high words first."""
    found = generator.bit_generator.state["state"]
    return [word for name in ("state", "inc") for word in (found[name] >> 64, found[name] & WORD)]


@inlined
def following(high, low, added_high, added_low):  # type: ignore[no-untyped-def]
    """Return the next state, the present one times the multiplier plus the increment, modulo 2^128."""
    first, second = low & MASK, low >> np.uint64(32)
    middle = second * LOWER + (first * LOWER >> np.uint64(32))
    other = first * UPPER + (middle & MASK)
    upper = second * UPPER + (middle >> np.uint64(32)) + (other >> np.uint64(32))
    product = low * MULTIPLIER_LOW
    total = product + added_low
    # A comparison would become an instruction that no vector has.
    carry = ((product & added_low) | ((product | added_low) & ~total)) >> np.uint64(63)
    return upper + high * MULTIPLIER_LOW + low * MULTIPLIER_HIGH + added_high + carry, total


@inlined
def output(high, low):  # type: ignore[no-untyped-def]
    """Return the 64 random bits of a state: both words, the one on the other, turned by the six highest bits."""
    value, turn = high ^ low, high >> np.uint64(58)
    return (value >> turn) | (value << (-turn & np.uint64(63)))


@inlined
def fraction(high, low):  # type: ignore[no-untyped-def]
    """Return the number in [0, 1) of a state."""
    return np.int64(output(high, low) >> np.uint64(11)) * 2.0**-53


@inlined
def candidate(high, low, layers):  # type: ignore[no-untyped-def]
    """Return the point in a layer of a state, and whether it lies under the curve for certain."""
    bits = output(high, low)
    layer, place = bits & np.uint64(255), float(np.int64(bits >> np.uint64(9) & MANTISSA))
    value = place * layers[0, layer]
    return (-value if bits & np.uint64(256) else value), place < layers[1, layer]


@called
def decided(high, low, a, b, layers):  # type: ignore[no-untyped-def]
    """Return the normal number of a state, certain or not, and the state that was reached for it."""
    while True:
        value, certain = candidate(high, low, layers)
        if certain:
            return value, high, low
        bits = output(high, low)
        layer = bits & np.uint64(255)
        high, low = following(high, low, a, b)
        if layer > 0:
            above = layers[2, layer - np.uint64(1)] - layers[2, layer]
            if above * fraction(high, low) + layers[2, layer] < math.exp(-0.5 * value * value):
                return value, high, low
        else:
            while True:
                beyond = -(1.0 / TAIL) * math.log1p(-fraction(high, low))
                high, low = following(high, low, a, b)
                if -2.0 * math.log1p(-fraction(high, low)) > beyond * beyond:
                    return (-(TAIL + beyond) if bits & np.uint64(2**17) else TAIL + beyond), high, low
                high, low = following(high, low, a, b)
        high, low = following(high, low, a, b)


@kept
@njit(error_model="numpy")
def fill_uniform(states, out, first, column, lanes):  # type: ignore[no-untyped-def]
    """Draw standard uniform numbers; arguments as of `fill_normal`."""
    begin, end = lanes
    block, place = begin // out.shape[3], begin % out.shape[3]
    high, low, a, b = states[0, begin:end], states[1, begin:end], states[2, begin:end], states[3, begin:end]
    for k in range(first, out.shape[1]):
        row = out[block, k, column, place:]
        for i in range(len(high)):
            high[i], low[i] = following(high[i], low[i], a[i], b[i])
            row[i] = fraction(high[i], low[i])


@kept
@njit(error_model="numpy")
def fill_normal(states, out, first, column, lanes, layers):  # type: ignore[no-untyped-def]
    """Draw standard normal numbers.

    Parameters
    ----------
    states : (4, n_lanes) array of uint64, changed in place
        `words` of each lane.
    out : (n_blocks, n, n_columns, width) array, written
        From row ``first`` on, in this column.
    first, column : int
    lanes : pair of int
        First lane of a block, and the one behind the last.
    layers : (3, 256) array of `ziggurat`
    """
    begin, end = lanes
    block, place = begin // out.shape[3], begin % out.shape[3]
    high, low, a, b = states[0, begin:end], states[1, begin:end], states[2, begin:end], states[3, begin:end]
    for k in range(first, out.shape[1]):
        row = out[block, k, column, place:]
        for i in range(len(high)):
            high[i], low[i] = following(high[i], low[i], a[i], b[i])
        for i in range(len(high)):  # apart, so that lanes run as vectors above
            value, certain = candidate(high[i], low[i], layers)
            if not certain:
                value, high[i], low[i] = decided(high[i], low[i], a[i], b[i], layers)
            row[i] = value
