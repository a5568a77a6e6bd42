"""``fdbench evaluate``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.checks.plugin_files import add_effects
from fdbench.commands._json import echo_json
from fdbench.commands._options import Effects, file_to_write, writable
from fdbench.commands._say import say
from fdbench.errors import SpecError
from fdbench.files import write_text
from fdbench.json_text import json_text


def evaluate(
    records: Annotated[list[Path], typer.Argument(help="CSV, Parquet, MAT or mapping TOML files.")],
    model: Annotated[
        list[Path], typer.Option(help="Model TOML, scenario file or scenario id; may be repeated to compare.")
    ],
    data: Annotated[Path | None, typer.Option(help="Folder of the files that mapping TOMLs name.")] = None,
    effect: Effects = None,
    json_: Annotated[
        Path | None, typer.Option("--json", callback=writable, help="File for the result as JSON; - prints it.")
    ] = None,
    html: Annotated[Path | None, typer.Option(callback=file_to_write, help="File for the page with plots.")] = None,
) -> None:
    """Say how well models predict records: in closed loop, by inverse dynamics, and one sample ahead."""
    from rich.console import Console

    from fdbench.diagnosis.evaluation.evaluate import evaluate as predict
    from fdbench.diagnosis.model.nominal import load_nominal
    from fdbench.reading import read_record
    from fdbench.report.evaluation_text import evaluation_text

    if data is not None and not any(path.suffix.lower() == ".toml" for path in records):
        raise SpecError(f"--data {data}: a folder for mapping files (.toml), but no record is one.")
    add_effects(effect)
    with Console(stderr=True).status("predicting"):
        stems = [path.stem if path.suffix.lower() == ".toml" else str(path) for path in model]
        names = stems if len(set(stems)) == len(stems) else [str(path) for path in model]
        if len(set(names)) < len(names):
            raise SpecError(f"--model {max(names, key=names.count)}: given twice.")
        models = {name: load_nominal(path) for name, path in zip(names, model, strict=True)}
        read = [read_record(path, data if path.suffix.lower() == ".toml" else None) for path in records]
        found = predict(models, read)
    if json_ is not None and str(json_) != "-":
        write_text(json_, json_text(found.evaluation.as_json()) + "\n")
    if html is not None:
        from fdbench.report.evaluation import write_evaluation

        write_evaluation(found, html)
    if str(json_) == "-":
        echo_json(found.evaluation.as_json())
    else:
        say(evaluation_text(found.evaluation))
