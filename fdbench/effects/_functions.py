"""Elementary functions for kernels, call-free.

A loop over instances that calls the C library neither vectorises nor gives the same bits everywhere; these do.
exp is within 1 unit in the last place, log too, tanh within 10, sin and cos within 2.3e-16 for arguments below 1e6 rad.
"""

import numpy as np
from numba import njit

from fdbench.compilation import kept

LOG2_E = 1.4426950408889634
LN2_HIGH = 6.93147180369123816490e-01
LN2_LOW = 1.90821492927058770002e-10
SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
TWO_OVER_PI = 0.6366197723675814
HALF_PI_HIGH = 1.57079632673412561417e00
HALF_PI_MIDDLE = 6.07710050630396597660e-11
HALF_PI_LOW = 2.02226624879595063154e-21
LOST, MOST_LOST = -64.0, 1e10  # e^-64 times 1e10 is 2e-18, less than 2^-54


@kept
@njit(error_model="numpy", forceinline=True)
def exp(x):
    x = min(max(x, -708.0), 709.0)
    k = np.floor(x * LOG2_E + 0.5)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    p = 1.0 / 6227020800.0
    p = p * r + 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * np.int64((np.int64(k) + 1023) << 52).view(np.float64)


@kept
@njit(error_model="numpy", forceinline=True)
def plus_exp(a, b, x):
    """Return a + b exp(x), to the bit, and do not wait for the exponential where the sum rounds it away."""
    lost = (x < LOST) & (abs(b) < MOST_LOST * a)
    return a if lost else a + b * exp(x)


@kept
@njit(error_model="numpy", forceinline=True)
def log(x):
    """Return the natural logarithm of a positive number that is not subnormal."""
    bits = np.float64(x).view(np.int64)
    k = (bits - SQRT_HALF_BITS) >> 52
    f = np.int64(bits - (k << 52)).view(np.float64) - 1.0
    s = f / (2.0 + f)
    q = s * s
    p = 1.0 / 21.0
    p = p * q + 1.0 / 19.0
    p = p * q + 1.0 / 17.0
    p = p * q + 1.0 / 15.0
    p = p * q + 1.0 / 13.0
    p = p * q + 1.0 / 11.0
    p = p * q + 1.0 / 9.0
    p = p * q + 1.0 / 7.0
    p = p * q + 1.0 / 5.0
    p = p * q + 1.0 / 3.0
    half = 0.5 * f * f
    return k * LN2_HIGH - ((half - (s * (half + 2.0 * q * p) + k * LN2_LOW)) - f)


@kept
@njit(error_model="numpy", forceinline=True)
def power(x, exponent):
    """Return a power of a positive number; 0 for others."""
    return exp(exponent * log(x if x > 0.0 else 1.0)) if x > 0.0 else 0.0


@kept
@njit(error_model="numpy", forceinline=True)
def tanh(x):
    e = exp(-2.0 * abs(x))
    large = (1.0 - e) / (1.0 + e)
    q = x * x
    small = abs(x) * (1.0 + q * (-1.0 / 3.0 + q * (2.0 / 15.0 + q * (-17.0 / 315.0 + q * (62.0 / 2835.0)))))
    value = small if abs(x) < 0.02 else large
    return np.copysign(value, x)


@kept
@njit(error_model="numpy", forceinline=True)
def _sin_reduced(r):
    q = r * r
    p = -1.0 / 1307674368000.0
    p = p * q + 1.0 / 6227020800.0
    p = p * q - 1.0 / 39916800.0
    p = p * q + 1.0 / 362880.0
    p = p * q - 1.0 / 5040.0
    p = p * q + 1.0 / 120.0
    p = p * q - 1.0 / 6.0
    return r + r * (q * p)


@kept
@njit(error_model="numpy", forceinline=True)
def _cos_reduced(r):
    q = r * r
    p = 1.0 / 20922789888000.0
    p = p * q - 1.0 / 87178291200.0
    p = p * q + 1.0 / 479001600.0
    p = p * q - 1.0 / 3628800.0
    p = p * q + 1.0 / 40320.0
    p = p * q - 1.0 / 720.0
    p = p * q + 1.0 / 24.0
    return 1.0 + q * (p * q - 0.5)


@kept
@njit(error_model="numpy", forceinline=True)
def _reduced(x):
    k = np.floor(x * TWO_OVER_PI + 0.5)
    return k, ((x - k * HALF_PI_HIGH) - k * HALF_PI_MIDDLE) - k * HALF_PI_LOW


@kept
@njit(error_model="numpy", forceinline=True)
def _quarter_wave(x, shift):
    k, r = _reduced(x)
    quadrant = (np.int64(k) + shift) & 3
    value = _cos_reduced(r) if quadrant & 1 else _sin_reduced(r)
    return -value if quadrant & 2 else value


@kept
@njit(error_model="numpy", forceinline=True)
def sin(x):
    return _quarter_wave(x, 0)


@kept
@njit(error_model="numpy", forceinline=True)
def cos(x):
    return _quarter_wave(x, 1)


@kept
@njit(error_model="numpy", forceinline=True)
def sin_cos(x):
    """Return what sin and cos do, to the bit, for less than both cost."""
    k, r = _reduced(x)
    quadrant = np.int64(k)
    s, c = _sin_reduced(r), _cos_reduced(r)
    sine, cosine = (c if quadrant & 1 else s), (s if quadrant & 1 else c)
    return (-sine if quadrant & 2 else sine), (-cosine if (quadrant + 1) & 2 else cosine)
