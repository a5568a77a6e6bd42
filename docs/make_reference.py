"""Write docs/reference from the registries: ``python docs/make_reference.py``, after any change of a plug-in.

Docstrings are data sheets already; they are turned into Markdown as they stand, beside what the code declares.
"""

import dataclasses
import importlib
import inspect
import json
import math
import re
import tempfile
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from fdbench.catalogue import scenario_ids
from fdbench.data_sheet import described, sections
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.diagnosis.model.rotary_axis import plant_of_rotary, plant_on_the_arc
from fdbench.effects import Effect, Port, effects
from fdbench.envs import environment_ids
from fdbench.envs.tasks import fitting, tasks
from fdbench.estimator import estimators
from fdbench.metrics import metrics
from fdbench.motions import Motion, motions
from fdbench.plants import Plant, plants
from fdbench.plants.feed_drive import FeedDrive
from fdbench.rotary import PARTS, rotary_name
from fdbench.scenario import Scenario, load_scenario
from fdbench.specification import snake_case
from fdbench.units import unit_of

FOLDER = Path(__file__).resolve().parent / "reference"
NOTE = "<!-- Written by docs/make_reference.py from docstrings and declarations; edit those, not this page. -->"
SMALLEST = 5e-324  # how a specification writes "above zero"


def inline(line: str) -> str:
    """Return a line of reStructuredText in Markdown."""
    return re.sub(r":math:`([^`]*)`", r"$\1$", line).replace("``", "`")


def markdown(text: str) -> str:
    """Return the text of a docstring in Markdown: formulas, code, examples."""
    found: list[str] = []
    lines = text.strip().splitlines()
    while lines:
        line = lines.pop(0)
        if line.startswith(".. math::"):
            formula = [line.removeprefix(".. math::").strip()]
            while lines and (not lines[0] or lines[0].startswith(" ")):
                formula.append(lines.pop(0).strip())
            found += ["", "```math", *filter(None, formula), "```", ""]
        elif line.startswith(">>>"):
            example = [line]
            while lines and lines[0]:
                example.append(lines.pop(0))
            found += ["```python", *example, "```"]
        else:
            found.append(inline(line))
    return re.sub(r"\n{3,}", "\n\n", "\n".join(found)).strip()


def table(header: str, rows: Iterable[Iterable[object]]) -> str:
    """Return a table in Markdown; the header's columns are divided by bars."""
    cells = [[str(cell).replace("|", r"\|") for cell in row] for row in rows]
    lines = [header.split("|"), ["---"] * len(header.split("|")), *cells]
    return "\n".join(f"| {' | '.join(cell.strip() for cell in line)} |" for line in lines) if cells else ""


def page(title: str, introduction: str, parts: Iterable[str]) -> str:
    """Return a whole page."""
    return "\n\n".join([NOTE, f"# {title}", introduction, *filter(None, parts)]) + "\n"


def contents(names: Iterable[tuple[str, str]]) -> str:
    """Return a table that leads to the sections below."""
    return table("name|says", [(f"[`{name}`](#{name.lower()})", line) for name, line in names])


# ---- effects


def effect(name: str) -> str:
    """Return the data sheet of an effect."""
    cls, parts = effects.get(name), sections(effects.get(name))
    facts = [f"Port `{cls.port.name}`"]
    facts += [f"no effect at {' = '.join(f'`{item}`' for item in (cls.amplitude, *cls.further_amplitudes))} = 0"]
    facts += [f"internal states {', '.join(f'`{state}`' for state in cls.states)}"] if cls.states else []
    facts += ["random"] if cls.random else []
    facts += ["a process force, to be estimated"] if cls.disturbance else []
    facts += ["the drive's own, and part of the disturbance to be estimated"] if cls.counts_as_disturbance else []
    facts += ["property of an elastic screw"] if cls.needs_screw else []
    facts += ["of an axis that turns"] if cls.needs_turn else []
    facts += ["looked for beside a baseline alone"] if cls.scales_every_value else []
    if cls.confusable_with:
        facts += [f"easily taken for {', '.join(f'[`{item}`](#{item})' for item in cls.confusable_with)}"]
    rows = (
        (f"`{item.name}`", f"`{item.symbol}`", item.unit, f"{item.low:g}", f"{item.high:g}", f"{item.typical:g}")
        for item in cls.parameters()
    )
    text = [f"## {name}", f"**{effects.summary(name)}**", markdown(parts[""]), "; ".join(facts) + "."]
    text += [table("parameter|symbol|unit|at least|at most|typical", rows)]
    return "\n\n".join([*text, markdown(parts.get("Examples", ""))]).strip()


def effects_page() -> str:
    """Return the page of effects."""
    names = sorted(effects.modules())  # those of packages, not of files
    introduction = (
        "What a real drive has beside the nominal model. One file each in `fdbench/effects/`; a scenario or a model "
        'names one by `kind = "..."` in a table `[[plant.effects]]` (modelled) or `[[reality.effects]]` (not '
        "modelled). *typical* is the size on a small axis. An example calls the kernel with "
        "`(t, h, x, v, u, parameters, states)`: time, substep, position, velocity, what passes the port."
    )
    ports = (inspect.getdoc(Port) or "").split("\n\n")[1]
    rows = [re.split(r"  +", line.strip()) for line in ports.splitlines() if not line.startswith("=")]
    said = ((f"`{row[0]}`", *row[1:]) for row in rows[1:])
    summaries = [(name, effects.summary(name)) for name in names]
    parts = [contents(summaries), "Where an effect enters:", table("port|kernel receives u|kernel returns", said)]
    return page("Effects", introduction, [*parts, *map(effect, names)])


# ---- estimators


def meanings(cls: type) -> dict[str, str]:
    """Return what is said of the constructor arguments, in Markdown."""
    return {name: inline(text) for name, text in described(cls).items()}


def estimator(name: str) -> str:
    """Return the data sheet of an estimator."""
    cls, parts = estimators.get(name), sections(estimators.get(name))
    meaning = meanings(cls)
    rows = (
        (f"`{key}`", unit_of(key), f"`{argument.default!r}`", meaning.get(key, ""))
        for key, argument in inspect.signature(cls).parameters.items()
    )
    text = [
        f"## {name}",
        f"**{estimators.summary(name)}**",
        markdown(parts[""]),
        table("argument|unit|default|is", rows),
    ]
    text += [f"Expected failure of the check `{check}`: {why}." for check, why in cls.expected_failures.items()]
    for label, section in (("Where it fails", "Validity"), ("Source", "References")):
        said = " ".join(parts.get(section, "").split())
        text += [f"{label}: {inline(said)}"] if said else []
    return "\n\n".join(filter(None, text))


def estimators_page() -> str:
    """Return the page of estimators."""
    names = sorted(estimators.modules())
    introduction = (
        "The reference estimators, one file each in `baselines/fdbench_baselines/`, written as yours would be. "
        "Each is given a `Context` (what is known before) and a `Record`, and returns an `Estimate` of `parameters`, "
        "`disturbance_N` and `output`, or those of them that it claims. A scenario may set arguments in "
        "`[estimation.hyperparameters.<name>]`. The row `oracle` of the results is no estimator: it is told the truth. "
        "What each is told, what it costs and where it fails, side by side: [rows](../how-to/rows.md)."
    )
    return page(
        "Estimators", introduction, [contents((n, estimators.summary(n)) for n in names), *map(estimator, names)]
    )


# ---- metrics


def metrics_page() -> str:
    """Return the page of metrics."""
    names = sorted(metrics.modules())
    introduction = (
        "One file each in `fdbench/metrics/`. Only what an estimator claims is scored. The primary metrics of a track "
        "make its ranking: the score of a run is the mean over them of (null - loss) / (null - oracle), clipped to "
        "[-1, 1], so that 1 is as good as knowing the truth and 0 as good as having learnt nothing."
    )
    kinds = {name: metrics.get(name) for name in names}
    rows = (
        (f"[`{name}`](#{name})", cls.track, "yes" if cls.primary else "", cls.unit, f"{cls.ideal:g}", f"{cls.worst:g}")
        for name, cls in kinds.items()
    )
    sheets = (
        f"## {name}\n\n**{metrics.summary(name)}**\n\n{markdown(sections(cls)[''])}" for name, cls in kinds.items()
    )
    return page("Metrics", introduction, [table("metric|track|primary|unit|ideal|worst", rows), *sheets])


# ---- tasks


def tasks_page() -> str:
    """Return the page of tasks."""
    names = sorted(tasks.modules())
    introduction = (
        "What an environment rewards: `gymnasium.make(id, task=name)`. One file each in `fdbench/envs/tasks/`; the "
        "task changes nothing of the machine. [More on environments](../how-to/environments.md)."
    )
    simulated = [load_scenario(name) for name in environment_ids()]
    reasons = {case.id: fitting(case, case.system()) for case in simulated}
    fit = {name: [case for case, found in reasons.items() if found[name] is None] for name in names}
    rows = ((f"[`{name}`](#{name})", tasks.summary(name), tasks.get(name).unit, len(fit[name])) for name in names)
    sheets = (
        f"## {name}\n\n**{tasks.summary(name)}**\n\n{markdown(sections(tasks.get(name))[''])}\n\n"
        f"Fits {', '.join(f'`{case}`' for case in fit[name])}, and what extends them."
        for name in names
    )
    return page("Tasks", introduction, [table("task|rewards|unit|fits", rows), *sheets])


# ---- scenarios


def scenario(name: str) -> str:
    """Return what a scenario is, in short; its file says the rest."""
    case = load_scenario(name)
    rows = [("plant", f"`{case.plant.name}`"), ("source", case.source)]
    if case.timing and case.motion:
        clock = f"{case.timing.n_samples} samples of {1e3 * case.timing.sampling_time_s:.4g} ms, each of "
        rows += [("record", f"{clock}{case.timing.substeps} substeps; motion `{case.motion.name}`")]
    if case.measured:
        rows += [("record", f"measured, `{case.measured.file}`, from {case.measured.obtain}")]
    known = getattr(case.plant, "effects", ())
    for label, found in (("nominal effects", known), ("unmodelled effects", case.reality.effects)):
        rows += [(label, ", ".join(f"[`{item.name}`](effects.md#{item.name})" for item in found))] if found else []
    noises = {field.name: getattr(case.reality.noise, field.name) for field in dataclasses.fields(case.reality.noise)}
    shown = ", ".join(f"`{key}` {value:.3g}" for key, value in noises.items() if value)
    rows += [("noise, standard deviation", shown)] if shown else []
    rows += [("model to identify", f"`{case.estimation.model}`"), ("tracks", ", ".join(case.estimation.tracks))]
    rows += [("suites", ", ".join(case.suites))]
    if case.environment:
        scale, reward = f"{case.environment.action_scale:g}", case.environment.reward
        rows += [("environment", f"an action of 1 adds {scale} to the command; reward by `{reward}`")]
    link = f"[`scenarios/{name}.toml`](../../scenarios/{name}.toml)"
    return f"## {name}\n\n**{case.title}.** {link}\n\n{table('what|is', rows)}"


def options(hint: Any) -> list[Any]:
    """Return what a value may be, without None."""
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return [item for item in typing.get_args(hint) if item is not types.NoneType] if union else [hint]


def tables(cls: type, titles: dict[type, str], owner: str = "") -> dict[type, str]:
    """Add a dataclass and those that its fields hold to ``titles``, each with a title that none has yet."""
    if cls in titles:
        return titles
    name = getattr(cls, "name", None) if issubclass(cls, Plant | Motion) else None
    title = name or snake_case(cls.__name__)
    titles[cls] = f"{title} of {owner}" if title in titles.values() else title
    for hint in typing.get_type_hints(cls).values():
        for part in (hint, *typing.get_args(hint)):
            for item in options(part):
                if isinstance(item, type) and dataclasses.is_dataclass(item):
                    tables(item, titles, titles[cls])
    return titles


def kind_of(hint: Any, titles: Mapping[type, str]) -> str:
    """Return how a value is written in TOML."""

    def link(cls: type) -> str:
        return f"[`{titles[cls].split()[0]}`](#{titles[cls].replace(' ', '-')})"

    if len(options(hint)) > 1:
        return f"table, kind {' or '.join(link(item) for item in options(hint))}"
    hint = options(hint)[0]
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        return f"list of {'' if inner[-1] is ... else f'{len(inner)} × '}{kind_of(inner[0], titles)}"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "table by name"
    if hint in (Effect, Plant, Motion):
        return f"{hint.__name__.lower()}, by its kind"
    if hint in titles:
        return f"table {link(hint)}"
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}[hint]


def bounds_of(field: dataclasses.Field[Any]) -> list[str]:
    """Return the bounds of a key in words."""
    low, high = field.metadata.get("low", -math.inf), field.metadata.get("high", math.inf)
    said = [] if low == -math.inf else ["above 0" if low == SMALLEST else f"at least {low:g}"]
    return said if high == math.inf else [*said, f"at most {high:g}"]


def allowed(field: dataclasses.Field[Any]) -> str:
    """Return the bounds of a key, and what holds where it is left out; nothing for a key without bounds."""
    said = bounds_of(field)
    if field.default in (None, ()) or field.default_factory is not dataclasses.MISSING:
        said += ["optional"]
    elif field.default is not dataclasses.MISSING:
        said += [f"default `{json.dumps(field.default)}`"]
    return ", ".join(said)


def keys(cls: Any, titles: Mapping[type, str]) -> str:
    """Return the keys of a table of a scenario file."""
    hints, meaning = typing.get_type_hints(cls), meanings(cls)
    rows = [
        (f"`{field.name}`", unit_of(field.name), kind_of(hints[field.name], titles), allowed(field), text)
        for field in dataclasses.fields(cls)
        if field.init
        for text in [meaning.get(field.name, "")]
    ]
    return f"### {titles[cls]}\n\n{markdown(sections(cls)[''])}\n\n{table('key|unit|is|allowed|says', rows)}"


def scenarios_page() -> str:
    """Return the page of scenarios and of the keys of their files."""
    names = scenario_ids()
    introduction = (
        "One file each in `scenarios/`, and nothing else: a scenario is data. Below the scenarios are "
        "[the keys of their files](#keys), which hold for your own scenarios. Models that `fdbench diagnose` is given "
        "are files of their own: [model files](model.md)."
    )
    said = (
        "The whole file is the table [`scenario`](#scenario). All of it is checked when it is read: unknown and "
        "missing keys, types and bounds. A key without *optional* or *default* is required. `kind` names a plant, "
        "a motion, an effect, or one of several tables."
    )
    titles = tables(Scenario, {})
    for registry in (plants, motions):
        for name in sorted(registry.modules()):
            tables(registry.get(name), titles)
    parts = [*map(scenario, names), "## Keys", said, *(keys(cls, titles) for cls in titles)]
    return page("Scenarios", introduction, [contents((n, load_scenario(n).title) for n in names), *parts])


# ---- model files

PARTS_OF_ROTARY = {linear: rotary for rotary, linear in PARTS.items()}
SMALLEST_MODEL = """
[plant]
kind = "feed_drive"
travel_m = 1.0
velocity_limit_m_per_s = 1.0
motor = { kind = "linear_motor", mass_kg = 1.0, viscous_friction_N_s_per_m = 1.0 }
[simulation]
substeps = 1
"""


def tables_of(hint: Any) -> list[Any]:
    """Return which dataclasses a table of a model may be; of plants only a feed drive is diagnosed."""
    found = [FeedDrive if item is Plant else item for item in options(hint)]
    return found if all(map(dataclasses.is_dataclass, found)) else []


def filled_in() -> dict[str, str]:
    """Return the kinds of tables of a plant that a model file may leave out, though a plant has them always."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "smallest.toml"
        file.write_text(SMALLEST_MODEL, encoding="utf-8")
        drive = load_nominal(file).drive
    given = tomllib.loads(SMALLEST_MODEL)["plant"]
    parts = {name: part for name, part in vars(drive).items() if name not in given and dataclasses.is_dataclass(part)}
    return {name: snake_case(type(part).__name__) for name, part in parts.items()}


def of_rotary(cls: Any, key: str) -> tuple[str, str]:
    """Return what a table of a model and one of its keys are called on a rotary axis."""
    kind = snake_case(cls.__name__)
    if cls in tables_of(typing.get_type_hints(FeedDrive)["motor"]):
        motor = plant_of_rotary({"motor": {"kind": kind, key: 1.0}})["motor"]
        return motor.pop("kind"), next(iter(motor))
    return kind, PARTS_OF_ROTARY.get(key, rotary_name(key))


def both(names: Iterable[str]) -> str:
    """Return one name, or two that differ."""
    return " or ".join(dict.fromkeys(names))


def model_title(path: str) -> str:
    """Return the title of a table of a model, with its name on a rotary axis."""
    parent, dot, name = path.rpartition(".")
    return both((path, f"{parent}{dot}{PARTS_OF_ROTARY.get(name, name)}"))


def model_value(path: str, field: dataclasses.Field[Any], hint: Any) -> str:
    """Return what a key of a model takes: its type and its bounds, or which table it is."""
    if not tables_of(hint) and Effect not in typing.get_args(hint):
        return ", ".join([kind_of(hint, {}), *bounds_of(field)])
    inner = f"{path}.{field.name}".lstrip(".")
    anchor = re.sub(r"[^\w -]", "", model_title(inner)).replace(" ", "-")
    return f"[table](#{anchor})" if tables_of(hint) else f"[list of tables](#{anchor})"


def model_default(field: dataclasses.Field[Any], left_out: Mapping[str, str]) -> str:
    """Return what holds where a key is left out."""
    if isinstance(field.default, str | int | float):
        return f"`{json.dumps(field.default)}`"
    if field.name in left_out:
        return f"kind `{left_out[field.name]}`"
    missing = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    return "required" if missing else "optional"


def model_keys(path: str, cls: Any) -> str:
    """Return the keys of a table of a model, beside them those of a rotary axis where they have other names."""
    hints, meaning, left_out = typing.get_type_hints(cls), meanings(cls), filled_in() if cls is FeedDrive else {}
    rows = [
        [
            *(cell for key in (field.name, of_rotary(cls, field.name)[1]) for cell in (f"`{key}`", unit_of(key))),
            model_default(field, left_out),
            model_value(path, field, hints[field.name]),
            meaning.get(field.name, ""),
        ]
        for field in dataclasses.fields(cls)
        if field.init
    ]
    if all(row[:2] == row[2:4] for row in rows):
        return table("key|unit|default|is|meaning", [row[2:] for row in rows])
    return table("linear axis|unit|rotary axis|unit|default|is|meaning", rows)


def model_kind(path: str, cls: Any, several: bool) -> str:
    """Return one kind of a table of a model."""
    kind, rotary = snake_case(cls.__name__), of_rotary(cls, dataclasses.fields(cls)[0].name)[0]
    said = f'`kind = "{kind}"`' + (
        "." if kind == rotary else f' on a linear axis, `kind = "{rotary}"` on a rotary one.'
    )
    text = [f"### {both((kind, rotary))}" if several else "", said if several or cls is FeedDrive else ""]
    return "\n\n".join(filter(None, [*text, markdown(sections(cls)[""]), model_keys(path, cls)]))


def model_tables(path: str, found: list[Any]) -> list[str]:
    """Return a table of a model, all its kinds, and the tables within it."""
    parts = [f"## {model_title(path) or 'The whole file'}"]
    parts += [model_kind(path, cls, len(found) > 1) for cls in found]
    hints = typing.get_type_hints(found[0])
    for key in [field.name for field in dataclasses.fields(found[0]) if field.init]:
        inner = f"{path}.{key}".lstrip(".")
        if tables_of(hints[key]):
            parts += model_tables(inner, tables_of(hints[key]))
        elif Effect in typing.get_args(hints[key]):
            names = ", ".join(f"[`{name}`](effects.md#{name})" for name in sorted(effects.modules()))
            said = (
                f"One table `[[{inner}]]` for each effect that is known, with its parameters and its `kind`: {names}."
            )
            parts += [f"## {inner}", said]
    return parts


def model_page() -> str:
    """Return the page of model files."""
    introduction = (
        "What `fdbench diagnose` reads, key by key; [how to write it](../how-to/diagnose.md#3-write-the-model). "
        "All of it is checked when it is read: unknown and missing keys, types and bounds. `[plant.motor]` names the "
        "table `motor` in the table `plant`.\n\n"
        'A linear axis and a rotary one, `axis = "rotary"`, have the same tables with other units: m is rad, N is N m, '
        "kg is kg m^2. Where a table below has two columns of keys, the first is for a linear axis and the second "
        "for a rotary one; where it has one, the keys are for both. Parameters of effects change their units alike.\n\n"
    )
    rotary = markdown(sections(plant_on_the_arc)[""].split("\n\n")[1])
    return page("Model file", introduction + rotary, model_tables("", [Nominal]))


# ---- what Python code calls

API = {
    "fdbench": ("diagnose", "run", "compare", "load_scenario", "read_record", "Record"),
    "fdbench.api": ("DiagnosisResult", "RunResult", "ComparisonResult"),
    "fdbench.estimator": ("Context", "Regression", "Estimate"),
    "fdbench.plants": ("Plant",),
}


def call(name: str, thing: Any) -> str:
    """Return how a function, method or class is called; types are said below."""
    parameters = []
    for item in inspect.signature(thing).parameters.values():
        if item.name != "self" and not item.name.startswith("_"):
            default = ... if "factory" in repr(item.default) else item.default
            parameters.append(item.replace(annotation=inspect.Parameter.empty, default=default))
    text = str(inspect.Signature(parameters)).replace("Ellipsis", "...")
    return f"`{name}{text}`"


def entries_of(section: str) -> list[tuple[str, str, str]]:
    """Return name, type and text of each entry of a section of a docstring."""
    found = re.findall(r"^(\S.*?)(?: : (.+))?\n((?:[ ]+.*\n?|\n(?=[ ]))*)", f"{section.strip()}\n", re.M)
    return [(name, inline(kind), inline(" ".join(body.split()))) for name, kind, body in found]


def entries(section: str) -> str:
    """Return the entries of a section of a docstring as a table."""
    return table("name|type|is", [(f"`{name}`", kind, text) for name, kind, text in entries_of(section)])


def described_in_full(thing: Any) -> list[str]:
    """Return the sections of a docstring in Markdown."""
    parts = sections(thing)
    raised = [f"Raises `{name}` {text[0].lower()}{text[1:]}" for name, _, text in entries_of(parts.get("Raises", ""))]
    return [
        markdown(parts[""]),
        *(entries(parts[key]) for key in ("Parameters", "Attributes") if key in parts),
        " ".join(raised),
        markdown(parts.get("Examples", "")),
    ]


def interface(home: str, name: str) -> str:
    """Return a function, or a class with its public methods and properties."""
    thing = getattr(importlib.import_module(home), name)
    text = [f"## {name}", f"`from {home} import {name}`"]
    text += [] if inspect.isabstract(thing) else [call(name, thing)]
    text += described_in_full(thing)
    for member, value in vars(thing).items() if inspect.isclass(thing) else ():
        own = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if member.startswith("_") or not inspect.isfunction(own):
            continue
        text += [f"### {name}.{member}", "" if isinstance(value, property) else call(f".{member}", own)]
        text += described_in_full(own)
    return "\n\n".join(filter(None, text))


def api_page() -> str:
    """Return the page of what Python code calls."""
    introduction = (
        "What scripts and notebooks call, and what an estimator is given. "
        "[How to use it](../how-to/python.md). What is not here may change from version to version."
    )
    listed = [(home, name) for home, names in API.items() for name in names]
    said = [(name, sections(getattr(importlib.import_module(home), name))[""].split("\n")[0]) for home, name in listed]
    parts = [contents((name, inline(line)) for name, line in said), *(interface(*item) for item in listed)]
    return page("Python", introduction, parts)


def pages() -> dict[str, str]:
    """Return the text of each page by file name."""
    return {
        "api.md": api_page(),
        "effects.md": effects_page(),
        "estimators.md": estimators_page(),
        "metrics.md": metrics_page(),
        "model.md": model_page(),
        "tasks.md": tasks_page(),
        "scenarios.md": scenarios_page(),
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for file, text in pages().items():
        (FOLDER / file).write_text(text, encoding="utf-8")
