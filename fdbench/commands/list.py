"""``fdbench list``."""

from enum import StrEnum
from typing import Annotated

import typer

from fdbench.commands._json import echo_json
from fdbench.commands._options import Json
from fdbench.commands._say import say


class Listed(StrEnum):
    """What can be listed."""

    SCENARIOS = "scenarios"
    ESTIMATORS = "estimators"
    EFFECTS = "effects"
    METRICS = "metrics"
    PLANTS = "plants"
    MOTIONS = "motions"
    TASKS = "tasks"
    DIAGNOSERS = "diagnosers"
    FORMATS = "formats"


WORDS = {
    Listed.SCENARIOS: "Machine, its reality, its command and what is to be found: the cases of the benchmark.",
    Listed.ESTIMATORS: "What is ranked: it claims parameters, disturbance or output from a record.",
    Listed.EFFECTS: "What a real axis has and its model may lack: frictions, compliances, errors of sensors and more.",
    Listed.METRICS: "What a claim is scored with, against the truth.",
    Listed.PLANTS: "Kinds of machine that a scenario may have.",
    Listed.MOTIONS: "Commands that a scenario may give.",
    Listed.TASKS: "What an environment rewards.",
    Listed.DIAGNOSERS: "What answers a blind trial of the diagnosis.",
    Listed.FORMATS: "Files that records and logs are read from.",
}


def list_(
    kind: Annotated[Listed | None, typer.Argument(help="What to list; without it the kinds, with counts.")] = None,
    json_: Json = False,
) -> None:
    """List scenarios, estimators, effects, metrics and so on, with one line on each; alone, what can be listed."""
    rows = [_kind_row(each) for each in Listed] if kind is None else _rows(kind)
    if json_:
        echo_json(rows)
        return
    cells = [[str(value) for value in row.values()] for row in rows]
    widths = [max((len(cell) for cell in column), default=0) for column in zip(*cells, strict=True)]
    for *first, last in cells:
        say("  ".join([*(f"{cell:{width}}" for cell, width in zip(first, widths, strict=False)), last]))


def _kind_row(kind: Listed) -> dict[str, str | int]:
    return {"name": kind.value, "count": len(_rows(kind)), "summary": WORDS[kind]}


def _rows(kind: Listed) -> list[dict[str, str]]:
    return _scenario_rows() if kind is Listed.SCENARIOS else _plugin_rows(kind)


def _scenario_rows() -> list[dict[str, str]]:
    from fdbench.catalogue import scenario_files
    from fdbench.specification import load_toml

    titles = {path.stem: str(load_toml(path).get("title", "")) for path in scenario_files()}
    return [{"name": f"fdbench/{name}", "summary": title} for name, title in sorted(titles.items())]


def _plugin_rows(kind: Listed) -> list[dict[str, str]]:
    from fdbench.registry import Registry

    registry: Registry[object] = Registry(kind.value.removesuffix("s"), object)
    rows = [{"name": name, "summary": registry.summary(name)} for name in registry.names()]
    if kind is Listed.ESTIMATORS:
        rows.append({"name": "oracle", "summary": "Reference row that knows the truth: the ceiling of every score."})
    return sorted(rows, key=lambda row: row["name"])
