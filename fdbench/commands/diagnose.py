"""``fdbench diagnose``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._json import echo_json, json_text
from fdbench.commands._options import Effects, file_to_write, writable
from fdbench.commands._plugins import add_effects
from fdbench.errors import SpecError


def diagnose(
    records: Annotated[list[Path], typer.Argument(help="CSV, Parquet, MAT or mapping TOML files.")],
    model: Annotated[Path, typer.Option(help="Model TOML, or a scenario file whose table plant is taken.")],
    holdout: Annotated[list[Path] | None, typer.Option(help="Record to judge on; may be repeated.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the files that mapping TOMLs name.")] = None,
    effect: Effects = None,
    json_: Annotated[
        Path | None, typer.Option("--json", callback=writable, help="File for the answer as JSON; - prints it.")
    ] = None,
    html: Annotated[Path | None, typer.Option(callback=writable, help="File for the report with plots.")] = None,
    write_model: Annotated[
        Path | None, typer.Option(callback=writable, help="File for the repaired model as TOML.")
    ] = None,
    next_experiment: Annotated[
        Path | None,
        typer.Option(callback=file_to_write, help="CSV file for the motion that would tell the causes in doubt apart."),
    ] = None,
    calibrate: Annotated[
        int,
        typer.Option(
            min=0,
            max=999,
            metavar="N",
            help="Learn the probabilities from N simulated cases of this machine, these motions and this noise; about "
            "3 s a case, kept for the next time. 80 are a good number.",
        ),
    ] = 0,
    rehearse: Annotated[int, typer.Option(min=0, max=999, hidden=True, help="Former name of --calibrate.")] = 0,
) -> None:
    """Say where the gap between a model and records lies, which effect causes it, and how far it shrinks."""
    from rich.console import Console

    from fdbench.diagnosis.diagnose import diagnose as find
    from fdbench.diagnosis.model.nominal import load_nominal
    from fdbench.reading import read_record
    from fdbench.record import Record
    from fdbench.report.diagnosis_text import summary

    def read(path: Path) -> Record:
        return read_record(path, data if path.suffix.lower() == ".toml" else None)

    if data is not None and not any(path.suffix.lower() == ".toml" for path in (*records, *(holdout or ()))):
        raise SpecError(f"--data {data}: a folder for mapping files (.toml), but no record is one.")
    if next_experiment is not None and next_experiment.suffix.lower() != ".csv":
        raise SpecError(f"--next-experiment {next_experiment}: the motion is written as .csv.")
    add_effects(effect)
    if rehearse:
        typer.echo(
            "fdbench: --rehearse is called --calibrate now; the former name goes with the next version.", err=True
        )
    note = Console(stderr=True)
    with note.status("reading") as status:
        nominal = load_nominal(model)
        fitted, judged = ([read(path) for path in paths] for paths in (records, holdout or ()))
        models = None
        if calibrate or rehearse:
            from fdbench.trials.machine_calibration import calibrated_models

            models = calibrated_models(nominal, fitted, judged, calibrate or rehearse, status.update)
        found = find(nominal, fitted, judged, status.update, models)
    if write_model is not None:
        from fdbench.diagnosis.repaired import write_repaired

        write_repaired(found, write_model)
        if not found.final.effects:
            typer.echo(f"fdbench: no cause was named: {write_model} is the re-calibrated model.", err=True)
    if next_experiment is not None:
        from fdbench.diagnosis.diagnose import write_experiment

        found = write_experiment(found, next_experiment)
        if found.answer.next_experiment is None:
            typer.echo(f"fdbench: no causes in doubt that a motion would tell apart: no {next_experiment}.", err=True)
    if json_ is not None and str(json_) != "-":
        json_.write_text(json_text(found.answer.as_json()) + "\n", encoding="utf-8")
    if html is not None:
        from fdbench.report.diagnosis import write_diagnosis

        write_diagnosis(found, html)
    if str(json_) == "-":
        echo_json(found.answer.as_json())
    else:
        typer.echo(summary(found.answer))
