"""What an evaluation says: the one place of its shape, in Python, as JSON, on the terminal and on the page."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fdbench.diagnosis.answer.quantity import Pair

ALL_RECORDS = "all records"
WAYS: Mapping[str, str] = {
    "closed_loop": "Closed loop: the command simulated with the model and its controller",
    "inverse_dynamics": "Inverse dynamics: motor force along the measured motion",
    "one_step_ahead": "One step ahead: position and velocity of the next sample",
}


@dataclass(frozen=True, kw_only=True)
class PredictionScore:
    r"""How well one model predicts one channel of a record, or of all of them.

    .. math::
        e = y - \hat y, \qquad \mathrm{RMSE} = \sqrt{\overline{e^2}}, \qquad
        \mathrm{fit} = 100 \left(1 - \frac{\lVert y - \hat y \rVert}{\lVert y - \bar y \rVert}\right) \%

    with the mean of each record for :math:`\bar y`. Source of the fit: Ljung (1999), System Identification, 2nd
    edition, section 16.4, as MATLAB's ``compare`` prints it.

    Attributes
    ----------
    way : str
        One of `WAYS`.
    model, record, channel, unit : str
        ``record`` is `ALL_RECORDS` for all of them together.
    root_mean_square_error : float
        In ``unit``.
    relative_error : float or None
        Of the standard deviation of the channel; None where that is zero.
    fit_percent : float or None
        100 (1 - ``relative_error``); negative where the mean predicts better.
    noise_floor : float
        Root mean square of what repeats or laps differ by over the root of two, else assumed.
    noise_measured : bool
        Whether the floor comes from repeats or laps.
    samples : int
    """

    way: str
    model: str
    record: str
    channel: str
    unit: str
    root_mean_square_error: float
    relative_error: float | None
    fit_percent: float | None
    noise_floor: float
    noise_measured: bool
    samples: int


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """Root mean square error of a model over that of the best one, with its 95 % bootstrap interval."""

    model: str
    value: float
    ci95: Pair


@dataclass(frozen=True, kw_only=True)
class ModelComparison:
    """Which model predicts a channel best over all records.

    Attributes
    ----------
    way, channel : str
    best : str
    ratios : tuple of Ratio
        Of every other model.
    certain : bool
        Whether every interval lies above 1.
    """

    way: str
    channel: str
    best: str
    ratios: tuple[Ratio, ...]
    certain: bool


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Answer of an evaluation; its fields are the keys of the JSON of ``fdbench evaluate --json``.

    Attributes
    ----------
    models, records : tuple of str
    band_Hz : float
        Up to which forces are compared by inverse dynamics; above it the derivatives of the position are noise.
    scores : tuple of PredictionScore
        Of each record, and where there are several, of all of them.
    comparisons : tuple of ModelComparison
        Empty for one model.
    warnings : tuple of str
    """

    models: tuple[str, ...]
    records: tuple[str, ...]
    band_Hz: float
    scores: tuple[PredictionScore, ...]
    comparisons: tuple[ModelComparison, ...]
    warnings: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the evaluation as JSON has it."""
        return dataclasses.asdict(self)
