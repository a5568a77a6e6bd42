"""How smooth a force is, and how loud the noise on it, from its spectrum."""

import numpy as np

from fdbench.estimator import FloatArray

LENGTHS, GAMMAS = 24, 24
SHORTEST_SAMPLES, LONGEST_SHARE = 1.0, 0.25
SMALLEST_GAMMA, LARGEST_GAMMA = 1e-2, 1e5


def likeliest_envelope(signal: FloatArray, step_s: float) -> tuple[float, float]:
    r"""Return length :math:`\sigma` (s) and signal-to-noise variance ratio :math:`\gamma` of a smooth signal in noise.

    .. math::
        \log L = -\sum_j \Big( \log s^2 S_j + \frac{I_j}{s^2 S_j} \Big), \qquad
        S_j = \frac{1}{\gamma} + \sum_k e^{-(k T_s)^2 / 2 \sigma^2} e^{-i \omega_j k}

    with the periodogram I of the signal under a Hann taper and the scale :math:`s^2` that suits it best, on a grid of
    both.

    Parameters
    ----------
    signal : (n,) array
        Uniformly sampled; its mean does not count.
    step_s : float
        Sampling time.

    References
    ----------
    Whittle, Estimation and information in stationary time series, Arkiv för Matematik 2 (1953).
    """
    n = len(signal)
    # Without a taper what leaks from a smooth force would be taken for noise.
    taper = np.hanning(n)
    taper /= np.sqrt(np.mean(taper**2))
    periodogram = np.abs(np.fft.rfft(taper * (signal - signal.mean()))[1:]) ** 2 / n
    frequency = 2.0 * np.pi * np.arange(1, len(periodogram) + 1) / n
    gammas = np.geomspace(SMALLEST_GAMMA, LARGEST_GAMMA, GAMMAS)
    best, found = -np.inf, (step_s, SMALLEST_GAMMA)
    for length in np.geomspace(SHORTEST_SAMPLES, max(LONGEST_SHARE * n, 2.0), LENGTHS):
        # The sum over k is that of a Gaussian and of its images, of which two are seen at the shortest length.
        shape = sum(np.exp(-0.5 * (length * (frequency - 2.0 * np.pi * i)) ** 2) for i in (-1, 0, 1))
        smooth = np.sqrt(2.0 * np.pi) * length * shape
        spectra = smooth + 1.0 / gammas[:, None]
        scale = np.mean(periodogram / spectra, axis=1)
        likelihood = -len(frequency) * np.log(np.maximum(scale, 1e-300)) - np.sum(np.log(spectra), axis=1)
        place = int(np.argmax(likelihood))
        if likelihood[place] > best:
            best, found = float(likelihood[place]), (float(length * step_s), float(gammas[place]))
    return found
