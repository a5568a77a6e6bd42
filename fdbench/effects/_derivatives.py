"""Derivatives of the functions that kernels call: a value, with its tangent behind it, for values with theirs.

``DERIVATIVES`` names the one of each function. Where two branches meet it is that of one of them; a staircase has 0.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from fdbench.effects import _functions as plain
from fdbench.effects._effect import kernel


@kernel
def smaller(a, tangent_a, b, tangent_b):
    return min(a, b), (tangent_a if a <= b else tangent_b)


@kernel
def larger(a, tangent_a, b, tangent_b):
    return max(a, b), (tangent_a if a >= b else tangent_b)


@kernel
def magnitude(x, tangent):
    return abs(x), (tangent if x >= 0.0 else -tangent)


@kernel
def square_root(x, tangent):
    root = math.sqrt(x)
    return root, 0.5 * tangent / root


@kernel
def rounded_down(x, tangent):
    return math.floor(x), 0.0


@kernel
def straight_through(x, tangent):
    return math.floor(x), tangent


@kernel
def exp(x, tangent):
    value = plain.exp(x)
    return value, value * tangent


@kernel
def plus_exp(a, tangent_a, b, tangent_b, x, tangent_x):
    value = plain.exp(x)
    return a + b * value, tangent_a + (tangent_b * value + b * (value * tangent_x))


@kernel
def log(x, tangent):
    return plain.log(x), tangent / x


@kernel
def power(x, tangent_x, exponent, tangent_exponent):
    value = plain.power(x, exponent)
    positive = x if x > 0.0 else 1.0
    return value, value * (exponent * tangent_x / positive + plain.log(positive) * tangent_exponent)


@kernel
def tanh(x, tangent):
    value = plain.tanh(x)
    return value, (1.0 - value * value) * tangent


@kernel
def sin(x, tangent):
    sine, cosine = plain.sin_cos(x)
    return sine, cosine * tangent


@kernel
def cos(x, tangent):
    sine, cosine = plain.sin_cos(x)
    return cosine, -sine * tangent


@kernel
def sin_cos(x, tangent):
    sine, cosine = plain.sin_cos(x)
    return sine, cosine * tangent, cosine, -sine * tangent


STAIRCASES = (math.floor, np.floor)
DERIVATIVES: Mapping[Any, Any] = MappingProxyType(
    {
        min: smaller,
        max: larger,
        abs: magnitude,
        math.sqrt: square_root,
        np.sqrt: square_root,
        **dict.fromkeys(STAIRCASES, rounded_down),
        plain.exp: exp,
        plain.plus_exp: plus_exp,
        plain.log: log,
        plain.power: power,
        plain.tanh: tanh,
        plain.sin: sin,
        plain.cos: cos,
        plain.sin_cos: sin_cos,
    }
)
