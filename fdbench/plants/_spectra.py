"""Segments of a record as spectra: lines of vibration, from which the lines of a force are to be estimated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.simulate.spectra import signals
from fdbench.simulate.system import FloatArray


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
