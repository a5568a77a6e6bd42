"""How far the gap shrinks, effect by effect."""

from dataclasses import dataclass, field

from fdbench.diagnosis.answer.quantity import Pair, Shares

JUDGED = {
    "held-out": "the records held out",
    "held-out repeats": "the last repeat of each motion, which was not fitted",
    "held-out laps": "the later laps, which were not fitted",
    "held-out last third of each record": "the last third of each record, which was not fitted",
}


@dataclass(frozen=True, kw_only=True)
class Step:
    """How the held-out mean squared gap, in units of the noise floor, falls with one more effect.

    Attributes
    ----------
    reduction : float
        1 - after / before, noise included, with its 95 % interval ``ci95``; ``channels`` has that of each channel.
    explained_fraction : float or None
        1 - (after - 1) / (before - 1), the fraction of what is beyond the noise; None where that is too little.
    beside_changes : bool
        Whether all of it is beside what friction changes by from run to run, which hides it in the whole gap.
    """

    added: str
    before: float
    after: float
    reduction: float
    ci95: Pair
    channels: Shares = field(default_factory=dict)
    explained_fraction: float | None = None
    beside_changes: bool = False


@dataclass(frozen=True, kw_only=True)
class Shrinkage:
    """How the held-out mean squared gap falls, in units of the noise floor.

    Attributes
    ----------
    judged_on : str
    steps : tuple of Step
    total : float
        1 - after / before of all steps, noise included, with its 95 % interval ``ci95``.
    reducible_left : float
        Share of what is left that is not noise.
    on_paper : float
        Of the nominal model.
    recalibrated, left : float or None
        Of the re-calibrated model without effects, and with all that is added; None in answers of before they were
        written, where steps follow from each other.
    explained_fraction : float or None
        Of the nominal gap beyond the noise, by re-calibration and all effects together; None where it is too small.
    """

    judged_on: str
    steps: tuple[Step, ...]
    total: float
    ci95: Pair
    reducible_left: float
    on_paper: float
    recalibrated: float | None = None
    left: float | None = None
    unit: str = "mean square in units of the noise floor"
    noise_floor: float = 1.0
    explained_fraction: float | None = None

    @property
    def judged_on_words(self) -> str:
        """What the gap is judged on, in words."""
        return JUDGED.get(self.judged_on, self.judged_on)
