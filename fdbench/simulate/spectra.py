"""Signals as lines of their spectrum, and back."""

import numpy as np

from fdbench.simulate.system import FloatArray


def lines(segments: FloatArray, n_lines: int) -> FloatArray:
    """Return the spectra (..., 2 n_lines) of segments (..., n_samples); the mean is left out.

    >>> lines(np.array([5.0, 3.0, 1.0, 3.0]), 1)  # 3 + 2 cos
    array([2., 0.])
    """
    spectrum = np.fft.rfft(segments)[..., 1 : n_lines + 1] * (2.0 / segments.shape[-1])
    return np.concatenate((spectrum.real, spectrum.imag), axis=-1)


def signals(rows: FloatArray, n_samples: int) -> FloatArray:
    """Return the time signals (..., n_samples) of spectra (..., 2 n_lines); their mean is zero.

    >>> signals(np.array([2.0, 0.0]), 4)
    array([ 2.,  0., -2.,  0.])
    """
    n_lines = rows.shape[-1] // 2
    spectrum = np.zeros((*rows.shape[:-1], n_samples // 2 + 1), dtype=np.complex128)
    spectrum[..., 1 : n_lines + 1] = (rows[..., :n_lines] + 1j * rows[..., n_lines:]) * (0.5 * n_samples)
    return np.fft.irfft(spectrum, n_samples)
