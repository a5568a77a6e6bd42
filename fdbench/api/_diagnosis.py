"""``diagnose`` as a function."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from fdbench.api._table import frame
from fdbench.checks.plugin_files import add_effects
from fdbench.cluster import processors
from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.diagnose import Diagnosis, write_experiment
from fdbench.diagnosis.diagnose import diagnose as find
from fdbench.diagnosis.model.nominal import Nominal, load_nominal, nominal_of
from fdbench.diagnosis.repaired import write_repaired
from fdbench.errors import SpecError, UnknownName, did_you_mean
from fdbench.files import write_text
from fdbench.json_text import json_text
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report import cards
from fdbench.report._curves import Curves
from fdbench.report._plotly import plotly_figure
from fdbench.report.diagnosis import write_diagnosis
from fdbench.report.diagnosis_text import summary
from fdbench.scenario import Scenario

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go

Model: TypeAlias = str | Path | Nominal | Scenario
Recording: TypeAlias = "str | Path | Record | pd.DataFrame"
Recordings: TypeAlias = "Recording | Sequence[Recording]"


@dataclass(frozen=True, eq=False)
class DiagnosisResult:
    """What a diagnosis found; a notebook shows the verdict, ``print`` the text of the command line.

    Attributes
    ----------
    diagnosis : Diagnosis
        With the hypotheses behind the answer, and their simulations.
    """

    diagnosis: Diagnosis

    @property
    def answer(self) -> Answer:
        """The answer, whose fields are the keys of the JSON."""
        return self.diagnosis.answer

    def causes(self) -> "pd.DataFrame":
        """Return a row for each cause: effect, kind, probability, shares of the mean squared gap, look-alikes."""
        columns = ("effect", "kind", "probability", "share", "unique_share", "indistinguishable_from")
        return frame(columns, ([getattr(cause, name) for name in columns] for cause in self.answer.causes))

    def parameters(self) -> "pd.DataFrame":
        """Return a row for each parameter of each cause, with its 95 % interval and unit.

        Bounds are NaN where there are none; ``fitted`` is False where the value is typical and not from the data.
        """
        rows = (
            (cause.effect, name, item.value, *(item.ci95 or (None, None)), item.unit, name not in cause.typical)
            for cause in self.answer.causes
            for name, item in cause.parameters.items()
        )
        return frame(("effect", "parameter", "value", "low", "high", "unit", "fitted"), rows)

    def gap(self) -> "pd.DataFrame":
        """Return a row for each channel: the gap before and after, and the noise floor, root mean square."""
        columns = ("before", "recalibrated", "repaired", "noise_floor", "unit", "reduction", "relative")
        channels = self.answer.gap.channels.items()
        return frame(("channel", *columns), ([name, *(getattr(own, key) for key in columns)] for name, own in channels))

    @property
    def channels(self) -> list[str]:
        """Names of the channels that were compared."""
        return self._curves.channels

    @property
    def _curves(self) -> Curves:
        return Curves(self.diagnosis)

    def figure(self, channel: str, over: str = "time", record: int = 0) -> "go.Figure":
        """Return the curves of a channel before and after the repair.

        Parameters
        ----------
        channel : str
            Its name, or a part that no other has: ``"force"`` for ``motor_force_N``.
        over : str
            ``"time"``, ``"position"`` (mean gap at each commanded position) or ``"frequency"`` (power density).
        record : int
            Place of the record among those that were simulated, for ``"time"``; the others hold for all of them.

        Raises
        ------
        UnknownName
            If there is no such channel, record or abscissa.
        """
        curves = self._curves
        names = [channel] if channel in curves.channels else [name for name in curves.channels if channel in name]
        if len(names) != 1:
            raise UnknownName(f"channel '{channel}': one of {', '.join(curves.channels)} is expected.")
        if not 0 <= record < len(curves.runs):
            raise UnknownName(f"record {record}: 0 to {len(curves.runs) - 1} are expected.")
        if record and over != "time":
            raise SpecError(f"record {record}: curves over {over} are of all records together.")
        drawn = {
            "time": lambda: curves.of_run(record, names),
            "position": lambda: curves.profile(names[0]),
            "frequency": lambda: curves.spectrum(names[0]),
        }
        if over not in drawn:
            raise UnknownName(f"over '{over}': one of {', '.join(drawn)} is expected.{did_you_mean(over, drawn)}")
        return plotly_figure(drawn[over]())

    def write_html(self, path: str | Path) -> None:
        """Write the report with all plots, one HTML file that needs no network."""
        write_diagnosis(self.diagnosis, path)

    def write_json(self, path: str | Path) -> None:
        """Write the answer as JSON."""
        write_text(path, json_text(self.answer.as_json()) + "\n")

    def write_model(self, path: str | Path) -> None:
        """Write the repaired model as TOML, which `diagnose` takes as a model."""
        write_repaired(self.diagnosis, path)

    def write_experiment(self, path: str | Path) -> "DiagnosisResult":
        """Write the motion that would tell the causes in doubt apart, and return the result with the file named.

        Nothing is written where no motion is proposed: ``answer.next_experiment`` is None then.
        """
        return replace(self, diagnosis=write_experiment(self.diagnosis, path))

    def __str__(self) -> str:
        return summary(self.answer)

    def _repr_html_(self) -> str:
        return cards.verdict_card(self.answer)


def diagnose(
    model: Model,
    records: Recordings,
    holdouts: Recordings = (),
    effects: Sequence[str | Path] = (),
    calibrate: int = 0,
    *,
    baseline: Recordings = (),
    data: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
    jobs: int | None = None,
) -> DiagnosisResult:
    """Say where the gap between a model and records lies, which effect causes it, and how far it shrinks.

    Parameters
    ----------
    model : path, Nominal or Scenario
        A model TOML or a scenario file; of a scenario the nominal plant is taken, never what it really is.
    records, holdouts : paths, Records or DataFrames, one or several
        Fitted on, and judged on. The columns of a DataFrame have the names that a CSV file has.
    effects : sequence of paths
        Python files of further effects.
    calibrate : int
        Learn the probabilities from so many virtual machines like this one, and say how often they were diagnosed
        rightly; 0: take those that the package was shipped with.
    baseline : as ``records``
        Of the axis when it was known to be well: the answer is then what has changed since.
    data : path, optional
        Folder of the files that mapping TOMLs among the records name.
    progress : callable, optional
        Told what is being done.
    jobs : int, optional
        Processes that diagnose virtual machines; by default one for each core.

    Raises
    ------
    FdbenchError
        If the model, a record or an effect cannot be read or used; the message says what to do.
    """
    given = _listed(records), _listed(holdouts), _listed(baseline)
    if data is not None and not any(_is_mapping(item) for items in given for item in items):
        raise SpecError(f"data {data}: a folder for mapping files (.toml), but no record is one.")
    add_effects(effects)
    nominal = _nominal(model)
    fitted, judged, before = ([_record(item, data) for item in items] for items in given)
    if not calibrate:
        return DiagnosisResult(find(nominal, fitted, judged, progress, None, before))
    from fdbench.trials.machine_calibration import calibration

    learned = calibration(nominal, fitted, judged, calibrate, progress, jobs or processors())
    found = find(nominal, fitted, judged, progress, learned.models, before)
    answer = replace(found.answer, virtual_machines=learned.outcome(found.features))
    return DiagnosisResult(replace(found, answer=answer))


def _nominal(model: Model) -> Nominal:
    if isinstance(model, Scenario):
        return nominal_of(model)
    return model if isinstance(model, Nominal) else load_nominal(model)


def _listed(records: Recordings) -> list[Recording]:
    if isinstance(records, Sequence) and not isinstance(records, str):
        return [*records]
    return [records]


def _is_mapping(item: Recording) -> bool:
    return isinstance(item, str | Path) and Path(item).suffix.lower() == ".toml"


def _record(item: Recording, data: str | Path | None) -> Record:
    if isinstance(item, str | Path):
        return read_record(item, data if _is_mapping(item) else None)
    return item if isinstance(item, Record) else Record({str(name): own.to_numpy() for name, own in item.items()})
