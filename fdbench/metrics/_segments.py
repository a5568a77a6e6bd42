"""Withheld segments of an outcome, claimed and true."""

from fdbench.errors import PluginError
from fdbench.metrics._metric import Outcome
from fdbench.metrics._series import Disturbance, claimed, no_disturbance
from fdbench.plants import SpectralPlant


def no_segments(outcome: Outcome) -> str | None:
    """Return why there are no segments to be compared, or None if there are."""
    if not isinstance(outcome.scenario.plant, SpectralPlant):
        return "the plant is not measured in segments"
    return no_disturbance(outcome)


def segments(outcome: Outcome) -> Disturbance:
    """Return the claimed and the true force of the withheld segments, N, (n_segments, samples_per_segment) each."""
    plant, truth = outcome.scenario.plant, outcome.truth.disturbance_N
    if not isinstance(plant, SpectralPlant) or truth is None:
        raise PluginError("disturbance_N: asked for although the true force of segments is not known.")
    shape = -1, plant.spectra(outcome.record).samples_per_segment
    return Disturbance(claimed(outcome, "disturbance_N").reshape(shape), truth[outcome.regression.rows].reshape(shape))
