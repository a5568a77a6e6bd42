"""Locate resonances: frequencies of a mass on a spring that the measured motion would move as the forces left ask."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from fdbench.diagnosis.evidence.inverse_dynamics import inertia_and_drag, table_position
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.records.spectral_lines import highest_Hz
from fdbench.diagnosis.settings import SEARCH
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray

DAMPING = 0.03  # of a structural mode of typical size
SPACING = 1.0 + DAMPING  # from frequency to frequency: no resonance lies between two that are tried
BIN_HZ = 0.1  # over which products of spectra are summed, of all runs: less than the width of the slowest resonance


def resonances(lacking: Sequence[FloatArray], split: Split, drive: FeedDrive) -> list[float]:
    r"""Return the frequencies (Hz) of a structural mode of which the residual forces have most, the likeliest first.

    For each frequency mass, damping and mode are fitted to the residual force D by weighted least squares,

    .. math::
        D(s) \approx \Bigl[m + \frac{B}{s} + m_f T_f(s)\Bigr] A(s), \qquad
        T_f(s) = \frac{2 \zeta \omega s + \omega^2}{s^2 + 2 \zeta \omega s + \omega^2}, \quad \omega = 2 \pi f

    with the measured acceleration A of the table: the carried mass :math:`m_f` follows it by :math:`T_f`. A motion that
    is known needs no simulation, so that frequencies are tried as densely as resonances are narrow. Returned are the
    peaks of the squares that a mode of positive mass removes beside the other two.

    Parameters
    ----------
    lacking : sequence of (n_samples - 3,) arrays
        Force on the table that the model lacks in each run, see `inverse_dynamics_residuals`.
    split : Split
    drive : FeedDrive
    """
    fastest_Hz = highest_Hz(max(run.period_s for run in split.runs))
    if fastest_Hz <= SEARCH.lowest_line_Hz:
        return []
    n_tried = int(np.log(fastest_Hz / SEARCH.lowest_line_Hz) / np.log(SPACING))
    tried_Hz: FloatArray = SEARCH.lowest_line_Hz * SPACING ** np.arange(n_tried, dtype=np.float64)
    n_bins = math.ceil(fastest_Hz / BIN_HZ)
    products = np.zeros((3, 3, n_bins), dtype=np.complex128)
    noise_N, noise_m = (split.noise_models[name].rms for name in ("motor_force_N", "position_m"))
    for run, force in zip(split.runs, lacking, strict=True):
        x, h = table_position(run.channels, drive), run.period_s
        signals = np.stack([inertia_and_drag(1.0, 0.0, x, h), inertia_and_drag(0.0, 1.0, x, h), force])
        n_padded = next_fast_len(len(force) + round(1.0 / (DAMPING * SEARCH.lowest_line_Hz * h)), real=True)
        at_Hz = np.fft.rfftfreq(n_padded, h)
        inside = (at_Hz > 0.5 * SEARCH.lowest_line_Hz) & (at_Hz < fastest_Hz)
        at_Hz, spectra = at_Hz[inside], np.fft.rfft(signals, n_padded)[:, inside]
        spectra /= np.hypot(noise_N, drive.mass_kg * (2.0 * np.pi * at_Hz) ** 2 * noise_m)
        place = (at_Hz / BIN_HZ).astype(np.intp)
        for row, column in itertools.product(range(3), range(3)):
            product = spectra[row].conj() * spectra[column]
            products[row, column] += np.bincount(place, product.real, n_bins)
            products[row, column] += 1j * np.bincount(place, product.imag, n_bins)
    centres_Hz: FloatArray = BIN_HZ * (np.arange(n_bins, dtype=np.float64) + 0.5)
    follows = transmissibility(tried_Hz[:, None], centres_Hz)
    normal, right = np.zeros((n_tried, 3, 3)), np.zeros((n_tried, 3))
    across = (follows.conj() @ products[0].T).real  # of the mode with acceleration, speed and force
    plain = products[:2].real.sum(axis=-1)
    normal[:, :2, :2], right[:, :2] = plain[:, :2], plain[:, 2]
    normal[:, 2, :2], right[:, 2] = across[:, :2], across[:, 2]
    normal[:, 2, 2] = np.abs(follows) ** 2 @ products[0, 0].real
    if not (np.isfinite(normal).all() and np.isfinite(right).all()):
        return []
    around = np.pad(_removed_beside_the_others(normal, right), 1)
    removed = around[1:-1]
    peaks = np.flatnonzero((removed > around[:-2]) & (removed >= around[2:]))
    return [float(tried_Hz[place]) for place in peaks[np.argsort(-removed[peaks])][: SEARCH.lines]]


def transmissibility(natural_Hz: FloatArray, at_Hz: FloatArray) -> NDArray[np.complex128]:
    """Return by how much a mass on a spring and a damper follows its base, :math:`T_f`, at some frequencies."""
    omega, s = 2.0 * np.pi * natural_Hz, 2j * np.pi * at_Hz
    pulled = 2.0 * DAMPING * omega * s + omega**2
    return np.asarray(pulled / (s**2 + pulled))


def _removed_beside_the_others(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the squares that the last of three numbers removes beside the others, (n,), none where it is negative.

    Parameters
    ----------
    normal, right : (n, 3, 3) and (n, 3) arrays
        Normal equations; of their last column only the last number is read.
    """
    held = 1e-12 * np.trace(normal[0]) * np.eye(2)
    of_others = np.linalg.solve(normal[:, :2, :2] + held, normal[:, 2, :2, None])[..., 0]
    left = right[:, 2] - np.einsum("fi,fi->f", of_others, right[:, :2])
    pivot = normal[:, 2, 2] - np.einsum("fi,fi->f", of_others, normal[:, 2, :2])
    is_told = (left > 0.0) & (pivot > 1e-9 * normal[:, 2, 2])
    return np.where(is_told, left**2 / np.maximum(pivot, 1e-300), 0.0)
