"""``fdbench trial``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.cluster import processors
from fdbench.commands._json import echo_json
from fdbench.commands._options import Jobs, Json, Scheduler, names_of, writable
from fdbench.commands._say import say
from fdbench.errors import SpecError, did_you_mean

trial = typer.Typer(
    help="Blind trials of the diagnosis: make records with sealed causes, answer, score.", no_args_is_help=True
)
Trial = Annotated[Path, typer.Argument(help="Folder of the trial; it never holds the key.")]


@trial.command("make")
def trial_make(
    folder: Trial,
    key: Annotated[Path, typer.Option(callback=writable, help="File for the key; keep it from whoever answers.")],
    tier: Annotated[
        str,
        typer.Option(
            help="A library's forms, B second implementation, C unlisted effects, D thin data, "
            "F foreign kinds of axis, G these to develop on, L to learn from."
        ),
    ] = "B",
    count: Annotated[int, typer.Option(min=1, max=999, help="Number of cases.")] = 20,
    nonce: Annotated[
        str | None, typer.Option(help="Hexadecimal digits of an opened key, to make a trial again.")
    ] = None,
    jobs: Jobs = None,
) -> None:
    """Draw axes with withheld effects, record them, and seal what was injected."""
    from rich.console import Console

    from fdbench.trials.make import make
    from fdbench.virtual_axes.cases import Tier

    if tier.upper() not in list(Tier):
        raise SpecError(f"tier: unknown tier '{tier}'.{did_you_mean(tier.upper(), list(Tier))}")
    with Console(stderr=True).status("making") as status:
        manifest = make(folder, key, Tier(tier.upper()), count, nonce, status.update, jobs or processors())
    say(f"{len(manifest['cases'])} cases of tier {manifest['tier']} in {folder}; key in {key}.")


@trial.command("answer")
def trial_answer(
    folder: Trial,
    output: Annotated[Path, typer.Option("-o", "--output", callback=writable, help="JSON file of answers.")],
    diagnoser: Annotated[
        str, typer.Option(autocompletion=names_of("diagnoser"), help="Name of a diagnoser, or its Python file.")
    ] = "fdbench",
    jobs: Jobs = None,
    scheduler: Scheduler = "",
) -> None:
    """Diagnose every case from its records and model alone; write the answers and their SHA-256."""
    from rich.console import Console

    from fdbench.trials.answer import answer
    from fdbench.trials.diagnoser import diagnosers

    with Console(stderr=True).status("answering") as status:
        found = answer(folder, diagnosers.resolve(diagnoser), output, status.update, scheduler, jobs or processors())
    failed = sum(case["status"] != "ok" for case in found["cases"].values())
    say(f"{len(found['cases'])} cases answered by {found['diagnoser']}, {failed} failed: {output}")


@trial.command("score")
def trial_score(
    folder: Trial,
    answers: Annotated[Path, typer.Argument(help="JSON file of answers; its .sha256 lies beside it.")],
    key: Annotated[Path, typer.Option(help="File of the key.")],
    json_: Json = False,
) -> None:
    """Check every seal and print the score sheet, with bootstrap intervals over cases."""
    from fdbench.trials.score import score, text

    found = score(folder, answers, key)
    if json_:
        echo_json(found)
    else:
        say(text(found))


@trial.command("learn")
def trial_learn(
    folders: Annotated[list[Path], typer.Argument(help="Folders of trials of tiers L and G.")],
    output: Annotated[Path, typer.Option("-o", "--output", callback=writable, help="TOML file of what is learned.")],
    key: Annotated[list[Path], typer.Option(help="File of the key; once for each folder, in their order.")],
    further: Annotated[
        bool, typer.Option(help="Go on from what the package has learned, instead of from nothing.")
    ] = False,
    jobs: Jobs = None,
) -> None:
    """Learn from trials of tiers L and G how far the diagnosis can be trusted; its probabilities are learned there."""
    from rich.console import Console

    from fdbench.diagnosis.judge import probability_models
    from fdbench.trials.forms import KINDS
    from fdbench.trials.learn import learn

    if len(key) != len(folders):
        raise SpecError(f"--key: {len(key)} for {len(folders)} folders; give one for each, in their order.")
    with Console(stderr=True).status("learning") as status:
        before = probability_models.models() if further else None
        found = learn(list(zip(folders, key, strict=True)), output, status.update, before, jobs or processors())
    for words in found.left_out:
        say(f"left out, for it cannot be diagnosed: {words}")
    for kind in KINDS:
        own = [claim.right for claim in found.claims if claim.kind == kind]
        say(f"{kind}: {len(own)} claims, {sum(own)} right")


@trial.command("guarantees")
def trial_guarantees(
    folder: Trial,
    answers: Annotated[Path, typer.Argument(help="JSON file of answers; its .sha256 lies beside it.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the two files, made if needed.")],
    key: Annotated[Path, typer.Option(help="File of the key.")],
) -> None:
    """Write the axes that cause sets and false alarms rest on, from a trial of tier G that was not learned from."""
    from fdbench.trials.guarantees import guarantees, write_guarantees

    single, empty = guarantees(folder, answers, key)
    write_guarantees(single, empty, output)
    say(f"{len(single.truth)} axes with one cause and {len(empty.surest)} without any: {output}")
