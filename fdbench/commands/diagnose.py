"""``fdbench diagnose``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._json import echo_json
from fdbench.commands._options import Effects, Jobs, file_to_write, writable
from fdbench.commands._say import say
from fdbench.errors import SpecError


def diagnose(
    records: Annotated[list[Path], typer.Argument(help="CSV, Parquet, MAT or mapping TOML files.")],
    model: Annotated[Path, typer.Option(help="Model TOML, or a scenario file whose table plant is taken.")],
    holdout: Annotated[list[Path] | None, typer.Option(help="Record to judge on; may be repeated.")] = None,
    baseline: Annotated[
        list[Path] | None,
        typer.Option(help="Record of the same machine before; may be repeated. Causes are of what changed since."),
    ] = None,
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
            help="Learn the probabilities from N virtual machines like this one, with these motions and this noise, "
            "and say how often they were diagnosed rightly; 1 to 2 s each on two cores, kept for the next time. 80 are "
            "a good number.",
        ),
    ] = 0,
    jobs: Jobs = None,
    rehearse: Annotated[int, typer.Option(min=0, max=999, hidden=True, help="Former name of --calibrate.")] = 0,
) -> None:
    """Say where the gap between a model and records lies, which effect causes it, and how far it shrinks."""
    from rich.console import Console

    from fdbench import api

    if next_experiment is not None and next_experiment.suffix.lower() != ".csv":
        raise SpecError(f"--next-experiment {next_experiment}: the motion is written as .csv.")
    if rehearse:
        say("fdbench: --rehearse is called --calibrate now; the former name goes with the next version.", is_aside=True)
    with Console(stderr=True).status("reading") as status:
        found = api.diagnose(
            model,
            records,
            holdout or (),
            effect or (),
            calibrate or rehearse,
            baseline=baseline or (),
            data=data,
            progress=status.update,
            jobs=jobs,
        )
    if next_experiment is not None:
        found = found.write_experiment(next_experiment)
        if found.answer.next_experiment is None:
            say(f"fdbench: no causes in doubt that a motion would tell apart: no {next_experiment}.", is_aside=True)
    if json_ is not None and str(json_) != "-":
        found.write_json(json_)
    if html is not None:
        found.write_html(html)
    if str(json_) == "-":
        echo_json(found.answer.as_json())
    else:
        say(str(found))
    if write_model is not None:  # last: a model that is refused costs no answer
        found.write_model(write_model)
        if not found.diagnosis.final.effects:
            say(f"fdbench: no effect was added: {write_model} is the re-calibrated model.", is_aside=True)
