"""The whole answer of a diagnosis, to JSON and from it."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fdbench.diagnosis.answer.cause import Cause, CauseSet, CauseType, FalseAlarms, RivalReduction, Suspect, chances
from fdbench.diagnosis.answer.experiment import Experiment
from fdbench.diagnosis.answer.gap import Gap, NoiseFloor
from fdbench.diagnosis.answer.parametric import Parametric
from fdbench.diagnosis.answer.process_force import ProcessForce
from fdbench.diagnosis.answer.quantity import Pair
from fdbench.diagnosis.answer.recorded import Recorded
from fdbench.diagnosis.answer.shrinkage import Shrinkage
from fdbench.diagnosis.answer.virtual_machines import VirtualMachines
from fdbench.diagnosis.answer.where import Dependence, Where
from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.errors import SpecError
from fdbench.rotary import LINEAR
from fdbench.specification import read

LARGEST = 1e100  # beyond it numbers can be neither drawn nor computed with


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
