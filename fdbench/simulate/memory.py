"""Arrays that begin where vectors of lanes are read and written fastest."""

import math

import numpy as np
from numpy.typing import NDArray

CACHE_LINE = 64  # bytes


def aligned_zeros(*shape: int) -> NDArray[np.float64]:
    """Return zeros that begin at a cache line, so that a row of 8 lanes lies in one and not across two.

    >>> values = aligned_zeros(2, 3)
    >>> values.shape, values.ctypes.data % CACHE_LINE
    ((2, 3), 0)
    """
    n = math.prod(shape)
    memory = np.zeros(n + CACHE_LINE // 8)
    first = -memory.ctypes.data % CACHE_LINE // 8
    return memory[first : first + n].reshape(shape)
