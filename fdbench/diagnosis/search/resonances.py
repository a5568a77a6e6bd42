"""Locate resonances: frequencies of a mass on a spring that the measured motion would move as the forces left ask."""

from collections.abc import Sequence

import numpy as np
from scipy.fft import next_fast_len

from fdbench.diagnosis.evidence.inverse_dynamics import inertia_and_drag, table_position
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.settings import MODEL, SEARCH
from fdbench.plants.feed_drive import FeedDrive
from fdbench.record import FloatArray

DAMPING = 0.03  # of a structural mode of typical size
SPACING = 1.0 + DAMPING  # from frequency to frequency: no resonance lies between two that are tried
BIN_HZ = 0.1  # over which products of spectra are summed: less than the width of the slowest resonance


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
    fastest = MODEL.highest_of_nyquist * 0.5 / max(run.period_s for run in split.runs)
    n = int(np.log(fastest / SEARCH.lowest_line_Hz) / np.log(SPACING))
    tried = SEARCH.lowest_line_Hz * SPACING ** np.arange(max(n, 0))
    normal, right = np.zeros((len(tried), 3, 3)), np.zeros((len(tried), 3))
    noise_N, noise_m = (split.noise_models[name].rms for name in ("motor_force_N", "position_m"))
    for run, force in zip(split.runs, lacking, strict=True):
        x, h = table_position(run.channels, drive), run.period_s
        n_padded = next_fast_len(len(force) + round(1.0 / (DAMPING * SEARCH.lowest_line_Hz * h)), real=True)
        at_Hz = np.fft.rfftfreq(n_padded, h)
        inside = (at_Hz > 0.5 * SEARCH.lowest_line_Hz) & (at_Hz < fastest)
        signals = np.stack([inertia_and_drag(1.0, 0.0, x, h), inertia_and_drag(0.0, 1.0, x, h), force])
        spectra = np.fft.rfft(signals, n_padded)[:, inside]
        at_Hz = at_Hz[inside]
        spectra /= np.hypot(noise_N, drive.mass_kg * (2.0 * np.pi * at_Hz) ** 2 * noise_m)
        firsts = np.arange(0, len(at_Hz), max(1, round(BIN_HZ * n_padded * h)))
        products = np.add.reduceat(spectra[:, None].conj() * spectra[None], firsts, axis=-1)
        counts = np.diff(firsts, append=len(at_Hz))
        s = 2j * np.pi * np.add.reduceat(at_Hz, firsts) / counts
        omega = 2.0 * np.pi * tried[:, None]
        follows = (2.0 * DAMPING * omega * s + omega**2) / (s**2 + 2.0 * DAMPING * omega * s + omega**2)
        squares = np.abs(follows) ** 2 @ products[0, 0].real
        # <follows A, other> = sum conj(follows) conj(A) other, of acceleration, speed and force in turn.
        across = (follows.conj() @ products[0].T).real
        plain = products[:2].real.sum(axis=-1)
        normal[:, :2, :2] += plain[:, :2]
        normal[:, 2, :2] += across[:, :2]
        normal[:, :2, 2] += across[:, :2]
        normal[:, 2, 2] += squares
        right[:, :2] += plain[:, 2]
        right[:, 2] += across[:, 2]
    if not len(tried) or not np.isfinite(normal).all() or not np.isfinite(right).all():
        return []
    # What a mode removes beside mass and damping: the last pivot of the normal equations.
    beside = np.linalg.solve(normal[:, :2, :2] + 1e-12 * np.trace(normal[0]) * np.eye(2), normal[:, :2, 2:])[..., 0]
    left = right[:, 2] - np.einsum("fi,fi->f", beside, right[:, :2])
    pivot = normal[:, 2, 2] - np.einsum("fi,fi->f", beside, normal[:, :2, 2])
    removed = np.where((left > 0.0) & (pivot > 1e-9 * normal[:, 2, 2]), left**2 / np.maximum(pivot, 1e-300), 0.0)
    around = np.pad(removed, 1)
    peaks = np.flatnonzero((removed > around[:-2]) & (removed >= around[2:]))
    return [float(tried[place]) for place in peaks[np.argsort(-removed[peaks])][: SEARCH.lines]]
