"""What `fdbench show` says of a scenario or a plug-in: facts, equation, arguments with units and defaults, file."""

import dataclasses
import inspect
import re
import typing
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from fdbench.data_sheet import described, plain, sections
from fdbench.units import unit_of

if TYPE_CHECKING:
    from fdbench.draw import Draw
    from fdbench.registry import Registry
    from fdbench.scenario import Scenario

Row = dict[str, str]

# Numbers within which anything is allowed.
_ANY = ("-inf", "inf")


@dataclasses.dataclass(frozen=True, kw_only=True)
class NameSheet:
    """What is said of one thing.

    Attributes
    ----------
    name, kind, summary : str
    facts : mapping of str to str
    text : str
        Equation and what else the docstring says, but its arguments.
    arguments : tuple of mappings
        Name, unit, default, bounds and meaning of each.
    file : str
    """

    name: str
    kind: str
    summary: str
    facts: Mapping[str, str]
    text: str = ""
    arguments: tuple[Row, ...] = ()
    file: str


def registries() -> "list[Registry[Any]]":
    """Return the plug-ins of each kind that `fdbench list` knows."""
    from fdbench.effects import effects
    from fdbench.envs.tasks import tasks
    from fdbench.estimator import estimators
    from fdbench.metrics import metrics
    from fdbench.motions import motions
    from fdbench.plants import plants
    from fdbench.reading.formats._format import formats
    from fdbench.trials.diagnoser import diagnosers

    return [estimators, effects, metrics, plants, motions, tasks, diagnosers, formats]


def plugin_sheets(name: str) -> list[NameSheet]:
    """Return the sheet of each plug-in of a name: of one kind, or of several."""
    from fdbench.benchmark import oracle

    found = [_plugin_sheet(registry, name) for registry in registries() if name in registry.names()]
    if name == oracle.NAME:
        own, file = sections(oracle.oracle)[""], inspect.getfile(oracle)
        summary, _, text = own.partition("\n")
        found.append(NameSheet(name=name, kind="reference row", summary=summary, facts={}, text=plain(text), file=file))
    return found


def _plugin_sheet(registry: "Registry[Any]", name: str) -> NameSheet:
    cls = registry.get(name)
    parts = sections(cls)
    kept = [parts[""].partition("\n")[2], *(parts.get(part, "") for part in ("Validity", "References"))]
    return NameSheet(
        name=name,
        kind=registry.kind,
        summary=plain(parts[""].partition("\n")[0]),
        facts=dict(_class_facts(registry.base, cls)),
        text=plain("\n\n".join(text.strip() for text in kept if text.strip())),
        arguments=tuple(_arguments(cls)),
        file=inspect.getfile(cls),
    )


def _class_facts(base: type, cls: type) -> Iterator[tuple[str, str]]:
    """Yield what a class says by its class attributes, where that is something."""
    for attribute, hint in inspect.get_annotations(base).items():
        value = getattr(cls, attribute, None)
        if "ClassVar" not in str(hint) or attribute in ("name", "kernel", "declared"):
            continue
        if attribute == "made_for":
            yield "made for", ", ".join(value) if value else "anything"
        elif isinstance(value, Mapping):
            yield from ((f"{attribute.replace('_', ' ')}: {key}", str(text)) for key, text in value.items())
        elif value not in (None, False, "", ()):
            yield attribute.replace("_", " "), _said(value)


def _said(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(_said, value))
    return "yes" if value is True else str(getattr(value, "name", value))


def _arguments(cls: Any) -> Iterator[Row]:
    """Yield a row for each constructor argument; those of a dataclass know their bounds."""
    meaning = described(cls)
    fields = {field.name: field.metadata for field in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else {}
    for name, argument in inspect.signature(cls).parameters.items():
        known: Mapping[str, Any] = fields.get(name, {})
        bounds = [f"{known[end]:g}" if end in known else free for end, free in zip(("low", "high"), _ANY, strict=True)]
        default = "" if argument.default is inspect.Parameter.empty else repr(argument.default)
        yield {
            "argument": name,
            "symbol": known.get("symbol", ""),
            "unit": unit_of(name),
            "default": "" if "factory" in default else default,
            "typical": f"{known['typical']:g}" if "typical" in known else "",
            "bounds": ""
            if tuple(bounds) == _ANY
            else f"{'above 0' if bounds[0] == '5e-324' else bounds[0]} to {bounds[1]}",
            "is": plain(meaning.get(name, "")),
        }


def scenario_sheet(scenario: "Scenario", source: str) -> NameSheet:
    """Return what a scenario is: machine, what is drawn, record, what is to be found, other versions and errata."""
    from fdbench.catalogue import scenario_folder

    return NameSheet(
        name=scenario.id,
        kind="scenario",
        summary=scenario.title,
        facts=dict(_scenario_facts(scenario)),
        file=source if source.endswith(".toml") else str(scenario_folder() / f"{scenario.id}.toml"),
    )


def _scenario_facts(case: "Scenario") -> Iterator[tuple[str, str]]:
    from fdbench.benchmark.leaderboard import ERRATA
    from fdbench.catalogue import scenario_ids

    yield "source", case.source
    yield "plant", case.plant.name
    for label, effects in (
        ("nominal effects", getattr(case.plant, "effects", ())),
        ("in reality", case.reality.effects),
    ):
        if effects:
            yield label, ", ".join(effect.name for effect in effects)
    noise = {field.name: getattr(case.reality.noise, field.name) for field in dataclasses.fields(case.reality.noise)}
    if said := ", ".join(f"{name} {value:.3g}" for name, value in noise.items() if value):
        yield "noise, deviation", said
    if case.timing is not None and case.motion is not None:
        clock = f"{case.timing.n_samples} samples of {1e3 * case.timing.sampling_time_s:.4g} ms"
        yield "record", f"{clock}, motion {case.motion.name}"
    if case.measured is not None:
        yield "record", f"measured, {case.measured.file}, from {case.measured.obtain}"
    yield "drawn", "; ".join(map(_draw_text, case.draw)) or "nothing: every seed is the nominal machine"
    yield "model to identify", case.estimation.model
    yield "tracks", ", ".join(case.estimation.tracks)
    yield "suites", ", ".join(case.suites) or "none"
    family = case.id.rpartition("-v")[0]
    versions = [name for name in scenario_ids() if name.rpartition("-v")[0] == family]
    yield "versions", ", ".join(versions) or "this one"
    for erratum in ERRATA:
        if any(re.fullmatch(pattern, case.id) for pattern in erratum.concerns):
            yield f"erratum of {erratum.version}", erratum.text


def _draw_text(draw: "Draw") -> str:
    spread = ", ".join(
        f"{name.replace('_', ' ')} {getattr(draw, name):.3g}"
        for name in typing.get_type_hints(type(draw))
        if name != "values"
    )
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(draw).__name__).lower()
    return f"{', '.join(draw.values)} ({kind}, {spread})"


def print_sheet(sheet: NameSheet) -> None:
    """Print a sheet; what a column would be empty of is left out."""
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    console.print(f"[bold]{escape(sheet.name)}[/]: {sheet.kind}. {escape(sheet.summary)}", soft_wrap=True)
    facts = Table.grid(padding=(0, 2, 0, 0))
    for label, text in (*sheet.facts.items(), ("file", sheet.file)):
        facts.add_row(f"{label}:", escape(text))
    console.print(facts)
    if sheet.text:
        console.print(f"\n{escape(sheet.text)}\n", highlight=False)
    if sheet.arguments:
        columns = [column for column in sheet.arguments[0] if any(row[column] for row in sheet.arguments)]
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        for column in columns:
            table.add_column(column, overflow="fold")
        for row in sheet.arguments:
            table.add_row(*(escape(row[column]) for column in columns))
        console.print(table)
