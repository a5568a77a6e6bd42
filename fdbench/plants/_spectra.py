"""Segments of a record as spectra: lines of vibration, from which the lines of a force are to be estimated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectra:
    r"""Spectra of the segments of a record, in order of time.

    Line k of a segment of N samples is :math:`c_k = \frac{2}{N} \sum_n x_n e^{-2 \pi j k n / N}`, the complex amplitude
    of a cosine. A row holds the real parts of lines 1 to ``n_lines``, then the imaginary parts.

    Attributes
    ----------
    features : (n_segments, 2 n_lines) array
        Acceleration, m/s^2.
    targets : (n_segments, 2 n_lines) array
        Force, N; zero where it is withheld.
    training : (n_segments,) array of bool
        Segments whose force was measured; that of the others is to be estimated.
    samples_per_segment : int
    """

    features: FloatArray
    targets: FloatArray
    training: NDArray[np.bool_]
    samples_per_segment: int

    def signals(self, rows: FloatArray) -> FloatArray:
        """Return rows of lines as time signals (n_rows, samples_per_segment)."""
        return signals(rows, self.samples_per_segment)


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
