"""``fdbench import``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._say import say, typed
from fdbench.errors import SpecError

INCOMPLETE = 1


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of one axis as its controller wrote them; or mappings, or the result of SINUMERIK's Automatic "
            "Servo Tuning, for a model alone."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for the files, made if needed; without it, beside each log."),
    ] = None,
    sampling_time: Annotated[
        float | None, typer.Option(min=1e-7, metavar="SECONDS", help="Sampling time, for logs without times.")
    ] = None,
) -> None:
    """Propose a mapping for each log and a first model of the axis, and say what was guessed and why."""
    from fdbench.files import write_text
    from fdbench.proposal import of_mapping, propose
    from fdbench.reading import format_of
    from fdbench.reading.servo_tuning import is_servo_tuning

    if output is not None and output.exists() and not output.is_dir():
        raise SpecError(f"--output {output}: a file, not a folder.")
    tunings = [file for file in files if file.is_file() and is_servo_tuning(_head(file))]
    if tunings:
        _import_tuning(files, output)
        return
    are_mappings = all(file.suffix.lower() == ".toml" for file in files)
    written = [(output or file.parent) / f"{file.stem}.toml" for file in files]
    model = written[0].with_name("model.toml")
    for path in [model] if are_mappings else [*written, model]:
        _refuse_existing(path)
        if [*written, model].count(path) > 1:
            raise SpecError(f"{path}: two files would have this name. Rename a log, or import them one by one.")
    if are_mappings:
        written, proposals = files, [of_mapping(file) for file in files]
    else:
        kinds = [format_of(file) for file in files]
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
        proposals = [propose(*each, sampling_time) for each in zip(files, kinds, written, strict=True)]
    for file, path, proposal in zip(files, written, proposals, strict=True):
        said = [proposal.format] if proposal.format else []
        said += [f"{proposal.record.n_samples} samples"] if proposal.record else []
        say(f"{file}: {', '.join(said)}")
        for line in (*proposal.found, *(f"left out {line}" for line in proposal.left_out)):
            say(f"  {line}")
        if not are_mappings:
            write_text(path, proposal.mapping)
            say(f"  -> {path}")
    best = next((proposal for proposal in proposals if proposal.record is not None), None)
    if best is not None:
        write_text(model, best.model([file.name for file in files]), folders=True)
        say(f"A first model, {best.axis}, without controller: {model}")
    to_do = dict.fromkeys(line for proposal in proposals for line in proposal.to_do)
    differing = [
        str(path) for path, proposal in zip(written, proposals, strict=True) if proposal.lines != proposals[0].lines
    ]
    if differing:
        to_do[f"CHECK the columns of {', '.join(differing)}: they are not those of {written[0]}."] = None
    say("\n".join(["To do:", *(f"  - {line}" for line in to_do)]) if to_do else "Nothing to fill in.")
    if any(proposal.record is None for proposal in proposals):
        raise typer.Exit(INCOMPLETE)
    say(f"Then: fdbench diagnose --model {typed(model)} {' '.join(map(typed, written))}")


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise SpecError(f"{path}: exists already. Remove it, or name another folder by --output.")


def _head(file: Path) -> bytes:
    with file.open("rb") as stream:
        return stream.read(4096)


def _import_tuning(files: list[Path], output: Path | None) -> None:
    """Write the model and the measured response of an axis whose tuning was saved."""
    from fdbench.files import write_text
    from fdbench.proposal import of_tuning

    if len(files) > 1:
        raise SpecError(f"{files[0]}: the result of a servo tuning is imported alone; {len(files)} files were given.")
    (file,) = files
    place = output or file.parent
    model, response = place / "model.toml", place / f"{file.stem}_response.csv"
    for path in (model, response):
        _refuse_existing(path)
    tuned = of_tuning(file)
    say(f"{file}: a result of Automatic Servo Tuning")
    for line in tuned.found:
        say(f"  {line}")
    write_text(model, tuned.model, folders=True)
    say(f"A model, {tuned.axis}: {model}")
    say("\n".join(["To do:", *(f"  - {line}" for line in tuned.to_do)]))
    if tuned.response:
        write_text(response, tuned.response)
        say(f"The measured response: {response}")
        page = place / f"{file.stem}.html"
        say(f"Then: fdbench show {typed(model)} {typed(response)} --sampling-time 1e-3 --output {typed(page)}")
