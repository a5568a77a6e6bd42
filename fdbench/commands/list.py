"""``fdbench list``."""

from enum import StrEnum
from typing import Annotated

import typer

from fdbench.commands._json import echo_json
from fdbench.commands._options import Json


class Kind(StrEnum):
    """What can be listed."""

    SCENARIOS = "scenarios"
    ESTIMATORS = "estimators"
    EFFECTS = "effects"
    METRICS = "metrics"


def list_(kind: Annotated[Kind, typer.Argument(help="What to list.")], json_: Json = False) -> None:
    """List scenarios, estimators, effects or metrics, with one line on each."""
    rows = _scenario_rows() if kind is Kind.SCENARIOS else _plugin_rows(kind)
    if json_:
        echo_json(rows)
        return
    width = max((len(row["name"]) for row in rows), default=0)
    for row in rows:
        typer.echo(f"{row['name']:{width}}  {row['summary']}")


def _scenario_rows() -> list[dict[str, str]]:
    from fdbench.catalogue import scenario_files
    from fdbench.specification import load_toml

    titles = {path.stem: str(load_toml(path).get("title", "")) for path in scenario_files()}
    return [{"name": f"fdbench/{name}", "summary": title} for name, title in sorted(titles.items())]


def _plugin_rows(kind: Kind) -> list[dict[str, str]]:
    from fdbench.registry import Registry

    registry: Registry[object] = Registry(kind.value.removesuffix("s"), object)
    rows = [{"name": name, "summary": registry.summary(name)} for name in registry.names()]
    if kind is Kind.ESTIMATORS:
        rows.append({"name": "oracle", "summary": "Reference row that knows the truth: the ceiling of every score."})
    return sorted(rows, key=lambda row: row["name"])
