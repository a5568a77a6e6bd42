"""Columns that functions of a spectrum span, and a force estimated from them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError, did_you_mean
from fdbench.estimator import Context, Estimate
from fdbench.plants import SpectralPlant
from fdbench.record import Record

FloatArray = NDArray[np.float64]

FUNCTIONS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "identity": lambda x: x,
    "square_root": lambda x: np.sqrt(np.abs(x)),
    "square": np.square,
    "exponential": np.exp,
    "cosine": lambda x: np.cos(2.0 * x),
}
LINEAR = ("identity",)
NONLINEAR = ("identity", "square_root", "square", "exponential")


def expand(features: FloatArray, functions: Sequence[str]) -> FloatArray:
    """Return a constant column, then each function of all features in turn.

    >>> expand(np.array([[-4.0]]), ("identity", "square_root", "square"))
    array([[ 1., -4.,  2., 16.]])

    Raises
    ------
    SpecError
        If a function is unknown.
    """
    for function in functions:
        if function not in FUNCTIONS:
            raise SpecError(f"functions: unknown function '{function}'.{did_you_mean(function, FUNCTIONS)}")
    return np.hstack([np.ones((len(features), 1)), *(FUNCTIONS[function](features) for function in functions)])


def declined(context: Context) -> str | None:
    """Return why a spectral estimator does not apply, or None if it does."""
    return None if isinstance(context.plant, SpectralPlant) else "the plant offers no spectra"


def estimate_force(
    context: Context,
    record: Record,
    functions: Sequence[str],
    solve: Callable[[FloatArray, FloatArray], FloatArray],
) -> Estimate:
    """Return the withheld force as time signals, from coefficients that ``solve`` gives for the training segments.

    Raises
    ------
    SpecError
        If the plant offers no spectra.
    """
    if not isinstance(context.plant, SpectralPlant):
        raise SpecError(f"{context.model}: {declined(context)}.")
    spectra = context.plant.spectra(record)
    G, training = expand(spectra.features, functions), spectra.training
    coefficients = solve(G[training], spectra.targets[training])
    return Estimate(disturbance_N=spectra.signals(G[~training] @ coefficients).ravel())
