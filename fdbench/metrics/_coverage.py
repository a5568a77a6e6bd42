"""Coverage of stated 95 % intervals."""

import numpy as np

from fdbench.regression import FloatArray

COVERAGE_PERCENT = 95.0
# Half width in standard deviations of the normal distribution.
HALF_WIDTH = 1.959963984540054


def coverage_error_percent(errors: FloatArray, variances: FloatArray) -> float:
    r"""Return how far the share of errors within :math:`\pm 1.96` standard deviations is from 95 %.

    >>> coverage_error_percent(np.array([0.0, 1.9, 2.0, -3.0]), np.ones(4))  # 50 % inside
    45.0
    """
    inside = np.abs(errors) <= HALF_WIDTH * np.sqrt(variances)
    return abs(100.0 * float(np.mean(inside)) - COVERAGE_PERCENT)
