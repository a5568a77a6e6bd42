"""What a diagnosis says: the one place of its shape, in Python, as JSON, on the terminal and on the page."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.errors import SpecError
from fdbench.rotary import LINEAR
from fdbench.specification import read

EFFECT, VALUE, READING = "effect", "value", "reading"  # kinds of causes
LARGEST = 1e100  # beyond it numbers can be neither drawn nor computed with
JUDGED = {
    "held-out": "the records held out",
    "held-out repeats": "the last repeat of each motion, which was not fitted",
    "held-out laps": "the later laps, which were not fitted",
    "held-out last third of each record": "the last third of each record, which was not fitted",
}

Pair = tuple[float, float]
Shares = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class ChannelGap:
    """Held-out gap of a channel, root mean square in its unit.

    Attributes
    ----------
    before, recalibrated, repaired : float
        Of the nominal model, with re-calibrated parameters, and with the named effects.
    reduction : float
        By which share the repaired mean square is below the re-calibrated one, noise included.
    noise_floor : float
    unit : str
    relative : float
        Of the nominal gap, to the standard deviation of the channel.
    """

    before: float
    recalibrated: float
    repaired: float
    reduction: float
    noise_floor: float
    unit: str
    relative: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Gaps of all channels by name."""

    channels: Mapping[str, ChannelGap]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Share of one cell of a partition, with its 95 % interval; the field that a kind adds holds its edges."""

    edges: ClassVar[str]

    share: float
    ci95: Pair | None = None

    @property
    def bounds(self) -> Pair:
        """Lower and upper edge."""
        low, high = getattr(self, self.edges)
        return low, high


@dataclass(frozen=True, kw_only=True)
class FrequencyCell(Cell):
    """Share of a band of frequency."""

    edges = "band_Hz"
    band_Hz: Pair


@dataclass(frozen=True, kw_only=True)
class PositionCell(Cell):
    """Share of a stretch of the way."""

    edges = "range_m"
    range_m: Pair


@dataclass(frozen=True, kw_only=True)
class VelocityCell(Cell):
    """Share of a range of commanded speed."""

    edges = "range_m_per_s"
    range_m_per_s: Pair


@dataclass(frozen=True, kw_only=True)
class TimeCell(Cell):
    """Share of a stretch of time."""

    edges = "range_s"
    range_s: Pair


@dataclass(frozen=True, kw_only=True)
class Where:
    """Partitions of the gap that re-calibration leaves, beyond the noise; the shares of each add up to 1, or to 0.

    Attributes
    ----------
    motion, channel : mapping of str to float
        Share of each phase of motion and of each channel.
    frequency, position, velocity, time : tuple of cells
    ci95 : mapping
        95 % intervals of the shares of ``motion`` and ``channel`` by name.
    """

    motion: Shares
    frequency: tuple[FrequencyCell, ...]
    position: tuple[PositionCell, ...]
    velocity: tuple[VelocityCell, ...]
    time: tuple[TimeCell, ...]
    channel: Shares
    ci95: Mapping[str, Mapping[str, Pair]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number with its 95 % interval, where there is one, and its unit."""

    value: float
    ci95: Pair | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class RivalReduction:
    """The best other effect, and which share of the held-out excess (or of force balances) it would remove."""

    effect: str
    reduction: float
    reduction_of_named: float | None = None


@dataclass(frozen=True, kw_only=True)
class ForceBalances:
    """Share of the squared force balances on motor and table that a cause removes, whatever the controller is."""

    reduction: float
    instead: RivalReduction | None = None


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One cause of the gap.

    Attributes
    ----------
    effect : str
    kind : str
        ``effect``: added to the model; ``value``: a nominal parameter that is wrong; ``reading``: seen in the readings
        themselves.
    probability : float
    share, unique_share : float
        Of the mean squared gap after re-calibration, shared by the mean over all orders, and what no other cause
        explains (no more than its share); of a value, of the nominal gap.
    parameters : mapping of str to Quantity
    indistinguishable_from : tuple of str
    share_of_channel : mapping of str to float
    alternatives : mapping of str to float
        Probabilities of what may be there in its place.
    one_of : tuple of str
        The fewest effects that hold the cause with a probability of 0.9.
    instead : RivalReduction or None
    force_balances : ForceBalances or None
    typical : tuple of str
        Parameters that were not found from the data.
    at_bound : tuple of str
        Parameters that lie on the bound of what the library allows.
    within_known : bool
        Whether it says no more than how a known friction turns its sign, or what that is in doubt by: no cause.
    beside_changes : bool
        Whether its shares, and its step of the shrinkage, are of the gap beside what friction changes by from run to
        run, which hides it in the whole.
    """

    effect: str
    probability: float
    share: float
    unique_share: float
    parameters: Mapping[str, Quantity]
    indistinguishable_from: tuple[str, ...] = ()
    kind: str = EFFECT
    parametric: bool = False
    share_of_channel: Shares = field(default_factory=dict)
    alternatives: Shares = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    instead: RivalReduction | None = None
    force_balances: ForceBalances | None = None
    typical: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()
    within_known: bool = False
    beside_changes: bool = False

    def __post_init__(self) -> None:
        # Answers of before ``kind`` say it by ``parametric``, which stays readable and written.
        if self.parametric and self.kind == EFFECT:
            object.__setattr__(self, "kind", VALUE)
        object.__setattr__(self, "parametric", self.kind == VALUE)


@dataclass(frozen=True, kw_only=True)
class FalseAlarms:
    """How often an axis without a cause is given one as sure as the surest of this answer.

    Attributes
    ----------
    at_most : float
        Probability of that on an axis that is exchangeable with those below (conformal p-value).
    as_sure, axes : int
        On how many of how many simulated axes without a cause it was so.
    exchangeable : bool
        False where more is left unexplained than on any of these.
    """

    at_most: float
    as_sure: int
    axes: int
    exchangeable: bool


@dataclass(frozen=True, kw_only=True)
class CauseSet:
    """Effects that the cause is among, if there is one.

    Attributes
    ----------
    causes : tuple of str
        Most probable first.
    everything : bool
        True where no effect of the library can be left out.
    holds : float
        Probability with which the one cause of an axis is in the set, if that axis is exchangeable with those below.
    axes : int
        Simulated axes with one cause.
    exchangeable : bool
        False where more is left unexplained than on any of these.
    """

    causes: tuple[str, ...]
    everything: bool
    holds: float
    axes: int
    exchangeable: bool


@dataclass(frozen=True, kw_only=True)
class CauseType:
    """A type of cause, on which side of the screw, and how probable it is that one of that type is there.

    Attributes
    ----------
    type : str
        One of `fdbench.effects.CAUSE_TYPES`.
    side : str or None
        ``motor`` or ``table``; None on a rigid axis and for what is between the two.
    """

    type: str
    side: str | None
    probability: float


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """An effect that the search came close to adding."""

    effect: str
    probability: float


@dataclass(frozen=True, kw_only=True)
class Most:
    """Where the force differs most, and by how much the motor gives more there than the final model."""

    # "from" and "to" in JSON, which are no names in Python.
    low: float
    high: float
    unit: str
    force_N: float


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """What the rest depends on, and the share of it that such a function removes."""

    function_of: str
    share: float
    most: Most | None = None


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


@dataclass(frozen=True, kw_only=True)
class ExpectedProbability:
    """Expected probability of the true cause, now and after a motion."""

    now: float
    after: float


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Effects that a motion tells apart, and the log odds that it is expected to bring, in nats."""

    effects: tuple[str, ...]
    expected_log_odds: float


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """The next experiment.

    Attributes
    ----------
    to_separate : tuple of str
    trajectory : str
        The motion in words, or the file that it was written to.
    kind, motion : str
        The motion without and with sizes.
    """

    to_separate: tuple[str, ...]
    trajectory: str
    expected_log_odds: float | None = None
    separates: tuple[Separation, ...] = ()
    expected_probability: ExpectedProbability | None = None
    expected_gain_per_s: float | None = None
    kind: str = ""
    motion: str = ""
    position_m: Pair | None = None
    amplitude_m: float | None = None
    velocity_m_per_s: float | None = None
    acceleration_m_per_s2: float | None = None
    duration_s: float | None = None
    file: str | None = None


@dataclass(frozen=True, kw_only=True)
class Parametric:
    """What re-calibration alone does.

    Attributes
    ----------
    closed_by_recalibration : float
    moved_in_standard_deviations : mapping of str to float
        How far each nominal parameter moves without effects, and beside them (``moved_beside_effects``).
    changes : mapping of str to Quantity
        By how much each moves without effects, as a share where it has no unit; empty in answers of before.
    values : mapping of str to Quantity
        The same of those that a cause changes, by its name, on both sides of a screw together, where that is further
        than any doubt.
    set_anew : mapping of str to Quantity
        By what share gains of the controller differ from those of the baseline; the nominal model has the new ones.
    """

    closed_by_recalibration: float
    moved_in_standard_deviations: Shares
    moved_beside_effects: Shares = field(default_factory=dict)
    changes: Mapping[str, Quantity] = field(default_factory=dict)
    values: Mapping[str, Quantity] = field(default_factory=dict)
    set_anew: Mapping[str, Quantity] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class NoiseBand:
    """Noise in a band of frequency, root mean square."""

    band_Hz: Pair
    value: float


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Noise of a channel, root mean square: in all, within a run, and what changes from run to run."""

    value: float
    unit: str
    measured_from_repeats: bool
    within_a_run: float | None = None
    from_run_to_run: float | None = None
    frequency: tuple[NoiseBand, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Course:
    """Course of a force: times and values, thinned."""

    time_s: tuple[float, ...]
    force_N: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ProcessForce:
    """A force that acts in a record of another condition, or that does not repeat with the motion.

    Attributes
    ----------
    record : str
    condition : str or None
        As the record names it.
    beside : str
        ``repeats``: it is what differs from records of the same command; ``model``: from the final model, the record
        being left out of all the rest; ``nominal``: from the nominal model, in a record that is diagnosed.
    rms_N, mean_N, largest_N : float
        On the axis, in the direction of its position, while it acts.
    standard_deviation_N : float
        Of each value.
    range_s : pair of float
        From when to when it acts: it is beyond three standard deviations, in stretches whose root mean square is too.
    frequency_Hz, amplitude_N : float or None
        Of the sine that is its strongest line while it acts, where that has a quarter of the squares.
    course : Course
    """

    record: str
    condition: str | None = None
    beside: str
    rms_N: float
    mean_N: float
    largest_N: float
    standard_deviation_N: float
    range_s: Pair
    frequency_Hz: float | None = None
    amplitude_N: float | None = None
    course: Course


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """How much was recorded.

    Attributes
    ----------
    records, samples : int
    sampling_time_s : float
    baseline : int
        Records of the machine before that it is compared with.
    force : Quantity or None
        Root mean square of the motor's force.
    """

    records: int
    samples: int
    sampling_time_s: float
    baseline: int = 0
    force: Quantity | None = None


@dataclass(frozen=True, kw_only=True)
class VirtualMachines:
    """How the diagnosis did on virtual machines like the measured one, whose causes are known.

    Attributes
    ----------
    cases : int
    with_cause, named_rightly : int
        Those with a cause that the library has, and those of them of which the cause that was named first is there.
    rightly_ci95 : pair of float
        Interval of that share.
    without_cause, named_falsely : int
        Those with nothing, and those of them of which a cause was named.
    compared : int
        Those without a cause that the library lacks.
    likeness : float
        Conformal p-value of the measured machine among these, by what is left beside all effects.
    """

    cases: int
    with_cause: int
    named_rightly: int
    rightly_ci95: Pair
    without_cause: int
    named_falsely: int
    compared: int
    likeness: float


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Answer of a diagnosis; its fields are the keys of the JSON of ``fdbench diagnose --json``.

    Attributes
    ----------
    gap : Gap
    where : Where
    causes : tuple of Cause
        Those that are more probable than not first, largest share first.
    suspects : tuple of Suspect
    types : tuple of CauseType
        Most probable first; where the effect is in doubt its type may not be.
    unknown_probability, no_gap_probability : float
    probabilities_from : str
        What they were learned from.
    nearest : RivalReduction or None
        The best effect that was not added, and the share of the excess that it would remove.
    rest_depends_on : tuple of Dependence
    shrinkage : Shrinkage
    next_experiment : Experiment or None
    warnings : tuple of str
    assumptions : tuple of str
        Those of the warnings that say how records were compared, and are no fault of theirs.
    parametric : Parametric
    noise_floor : mapping of str to NoiseFloor
    process_forces : tuple of ProcessForce
        Of records of another condition, which are left out of all the rest, and of those whose laps do not repeat.
    recorded : Recorded or None
    virtual_machines : VirtualMachines or None
        With a machine-specific calibration.
    false_alarms : FalseAlarms or None
    cause_set : CauseSet or None
        Both None in answers of before they were said, and of what has changed since a baseline.
    axis : str
        ``linear`` or ``rotary``: then every m is a rad, every N a N m, and every kg a kg m^2.
    """

    gap: Gap
    where: Where
    causes: tuple[Cause, ...]
    suspects: tuple[Suspect, ...] = ()
    types: tuple[CauseType, ...] = ()
    unknown_probability: float
    no_gap_probability: float
    probabilities_from: str = ""
    nearest: RivalReduction | None = None
    rest_depends_on: tuple[Dependence, ...] = ()
    shrinkage: Shrinkage
    next_experiment: Experiment | None
    warnings: tuple[str, ...]
    assumptions: tuple[str, ...] = ()
    parametric: Parametric
    noise_floor: Mapping[str, NoiseFloor]
    process_forces: tuple[ProcessForce, ...] = ()
    recorded: Recorded | None = None
    virtual_machines: VirtualMachines | None = None
    false_alarms: FalseAlarms | None = None
    cause_set: CauseSet | None = None
    axis: str = LINEAR

    def as_json(self) -> dict[str, Any]:
        """Return the answer as JSON has it."""
        found: dict[str, Any] = _renamed(dataclasses.asdict(self), _IN_JSON)
        return found

    def chances(self) -> dict[str, float]:
        """Return the probability of each effect that is named, suspected or an alternative to one that is named."""
        return chances(self.causes, self.suspects)

    def sizes(self) -> Pair:
        """Return the mean squared gap in units of the noise floor, of the nominal model and re-calibrated."""
        nominal, steps = self.shrinkage.on_paper, self.shrinkage.steps
        if self.shrinkage.recalibrated is not None:
            return nominal, self.shrinkage.recalibrated
        return nominal, steps[0].before if steps else nominal * (1.0 - self.parametric.closed_by_recalibration)

    def left(self) -> float:
        """Return the mean squared gap in units of the noise floor with all that is added."""
        if self.shrinkage.left is not None:
            return self.shrinkage.left
        return self.shrinkage.steps[-1].after if self.shrinkage.steps else self.sizes()[1]

    def unexplained(self) -> float:
        """Return the share of the mean squared gap after re-calibration that is neither explained nor noise.

        Where effects make the gap larger they explain none of it.
        """
        size = self.sizes()[1]
        return max(0.0, min(self.left(), size) - 1.0) / size if size > 0.0 else 0.0


def chances(causes: Iterable[Cause], suspects: Iterable[Suspect]) -> dict[str, float]:
    """Return the probability of each effect: its own where it is named or suspected, else as an alternative."""
    found: dict[str, float] = {}
    for cause in causes:
        for name, chance in cause.alternatives.items():
            found[name] = max(found.get(name, 0.0), chance)
    found |= {suspect.effect: suspect.probability for suspect in suspects}
    return found | {cause.effect: cause.probability for cause in causes}


_IN_JSON = {"low": "from", "high": "to"}


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Return nested tables with other names for keys of `Most`, the only table that has them."""
    if isinstance(value, Mapping):
        own = names if {*names} <= value.keys() else {}
        return {own.get(key, key): _renamed(item, names) for key, item in value.items()}
    return [_renamed(item, names) for item in value] if isinstance(value, list | tuple) else value


def from_json(table: Any, where: str = "answer") -> Answer:
    """Return the answer that was written as JSON.

    Raises
    ------
    SpecError
        If a key is unknown, missing or of another type, or a number too large to be drawn.
    """
    answer = read(Answer, _renamed(table, {name: key for key, name in _IN_JSON.items()}), where)
    for place, value in _numbers(dataclasses.asdict(answer), where):
        if abs(value) > LARGEST:
            raise SpecError(f"{place}: {value:g} is too large to be drawn.")
    return answer


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{where}.{key}")
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from _numbers(item, f"{where}[{index}]")
    elif isinstance(value, float):
        yield where, value


def read_answer(path: str | Path) -> Answer:
    """Return the answer in a file of ``fdbench diagnose --json``.

    Raises
    ------
    SpecError
        If the file cannot be read or holds no such answer.
    """
    file = Path(path)
    try:
        table = json_value(read_file(file, LARGEST_JSON), is_finite=False)
    except OSError as error:
        raise SpecError(f"{file}: cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise SpecError(f"{file}: not JSON: {error}.") from error
    return from_json(table, file.name)
