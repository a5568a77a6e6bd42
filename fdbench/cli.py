"""The command line; every command imports what it needs when it runs, so that ``fdbench list`` is quick."""

import json
import math
import os
import sys
from collections.abc import Iterable, Mapping
from enum import StrEnum
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from threadpoolctl import threadpool_limits
from typer.core import TyperGroup

from fdbench.errors import FdbenchError, PluginError, SpecError, did_you_mean

# For the processes of a run; in this one, numpy is imported before this line is reached.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Columns of a table that goes to a file or another program, unless COLUMNS says otherwise.
WIDE = "160"
INTERRUPTED = 130


class Commands(TyperGroup):
    """The commands: 0 good, 1 a check failed, 2 bad usage or bad input with one message on standard error."""

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Run a command and exit."""
        try:
            code = super().main(*args, **{**options, "standalone_mode": False})
        except FdbenchError as error:
            refuse(f"fdbench: {error}")
        except typer.TyperException as error:
            context = getattr(error, "ctx", None)
            command = context.command_path if context else "fdbench"
            text = " ".join(error.format_message().replace("Value error, ", "").split())
            refuse(f"{command}: {(text or 'A command is missing').rstrip('.')}. Try '{command} --help'.")
        except OSError as error:
            if error.errno is None:
                raise
            refuse(f"fdbench: {f'{error.filename}: ' if error.filename else ''}{error.strerror}.")
        except MemoryError as error:
            refuse(f"fdbench: not enough memory for this input: {error}")
        if code == INTERRUPTED:
            typer.echo("fdbench: interrupted; what is finished is kept.", err=True)
        sys.exit(code)


def refuse(message: str) -> NoReturn:
    """Say what is wrong and exit with 2."""
    typer.echo(message, err=True)
    sys.exit(2)


app = typer.Typer(
    name="fdbench",
    cls=Commands,
    help="Benchmark of machine-tool feed drives: simulate, estimate, score, diagnose. Begin with 'fdbench run'.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Kind(StrEnum):
    """What can be listed."""

    SCENARIOS = "scenarios"
    ESTIMATORS = "estimators"
    EFFECTS = "effects"
    METRICS = "metrics"


class Suite(StrEnum):
    """Selections of scenarios."""

    QUICK = "quick"
    FULL = "full"


DEFAULT_OUT = Path("results")
SEEDS = {Suite.QUICK: 3, Suite.FULL: 10}


def writable(path: Path | None) -> Path | None:
    """Return a file to write; one that cannot be made is refused before anything long is computed for it."""
    if path is None or str(path) == "-":
        return path
    if path.is_dir():
        raise FdbenchError(f"{path}: a folder, where a file to write is expected.")
    if not path.parent.is_dir():
        raise FdbenchError(f"{path}: cannot be written: there is no folder {path.parent}.")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise FdbenchError(f"{path}: cannot be written: permission denied.")
    return path


def file_to_write(path: Path | None) -> Path | None:
    """Return a file to write, as `writable`; ``-`` is refused where nothing can be printed in place of a file."""
    if str(path) == "-":
        raise FdbenchError("-: the name of a file is expected here.")
    return writable(path)


def results_folder(path: Path) -> Path:
    """Return a folder to write in, which need not exist yet."""
    nearest = next(parent for parent in (path, *path.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise FdbenchError(f"{path}: cannot be made: {nearest} is a file, not a folder.")
    if not os.access(nearest, os.W_OK):
        raise FdbenchError(f"{path}: cannot be written: permission denied.")
    return path


Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="FILE",
        help="Python file of a further effect, for scenarios and diagnoses; may be repeated.",
    ),
]
Html = Annotated[Path, typer.Option("-o", "--output", callback=file_to_write, help="HTML file to write.")]


def json_text(value: object) -> str:
    """Return a value as JSON; numbers that JSON lacks, which are infinite or none, become null."""
    return json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)


def _finite(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def echo_json(value: object) -> None:
    """Print a value as JSON on standard output."""
    typer.echo(json_text(value))


def add_effects(files: Iterable[str] | None) -> None:
    """Register effects by their files, and refuse those whose kernel does not fit what they declare."""
    if not files:
        return
    from functools import partial

    from fdbench.checks._report import run_checks
    from fdbench.checks.check_effect import Bench, Case, declares_what_the_kernel_takes, returns_finite_values
    from fdbench.effects import effects

    for file in distinct(files):
        effect = effects.get(effects.add_file(file))
        case = Case(effect, Bench([effect]))
        for fits in (declares_what_the_kernel_takes, returns_finite_values):
            run_checks(file, [(fits.__name__, partial(fits, case))])


def distinct(names_or_files: Iterable[str]) -> list[str]:
    """Return names and files as they are; two files of one name are refused, for the file name is the plug-in's."""
    given: dict[str, Path] = {}
    for file in (Path(item) for item in names_or_files if item.endswith(".py")):
        if os.path.realpath(given.setdefault(file.stem, file)) != os.path.realpath(file):
            raise PluginError(f"{given[file.stem]} and {file}: two plug-ins of one name. Rename one of the files.")
    return list(names_or_files)


@app.command("list")
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


@app.command()
def run(
    suite: Annotated[
        Suite, typer.Option(help="Scenarios to run, unless --scenario names some: a selection, or all.")
    ] = Suite.QUICK,
    scenario: Annotated[
        list[str] | None, typer.Option(metavar="ID|FILE", help="Id or TOML file of a scenario; may be repeated.")
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Name or Python file of an estimator; may be repeated. Default: all installed ones. null and oracle, "
            "which scores are measured against, always run.",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, help="Number of seeds, that is of repeats with other noise; quick: 3, full: 10."),
    ] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed; the others follow it.")] = 0,
    effect: Effects = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")] = None,
    out: Annotated[
        Path,
        typer.Option(callback=results_folder, help="Folder of results; what it holds and still applies is kept."),
    ] = DEFAULT_OUT,
    keep_estimates: Annotated[
        bool, typer.Option("--keep-estimates", help="Keep records and estimates of every seed, not of the first alone.")
    ] = False,
) -> None:
    """Run estimators on scenarios, score and rank them; what is finished and has not changed is not run again."""
    from rich.console import Console

    from fdbench.benchmark import console, leaderboard
    from fdbench.benchmark.run import run as run_benchmark
    from fdbench.benchmark.run import select
    from fdbench.benchmark.store import Store
    from fdbench.catalogue import scenario_ids
    from fdbench.estimator import estimators
    from fdbench.report import write_report
    from fdbench.scenario import load_scenario

    add_effects(effect)
    chosen = scenario or [name for name in scenario_ids() if suite in load_scenario(name).suites]
    names = [*select(distinct(estimator))] if estimator else estimators.names()
    screen = Console()
    with console.progress(screen) as shown:
        summary = run_benchmark(
            chosen,
            names,
            seeds or SEEDS[suite],
            out,
            first_seed=first_seed,
            jobs=jobs or os.cpu_count() or 1,
            keep_estimates=keep_estimates,
            progress=shown,
        )
    store = Store(out)
    text = leaderboard.leaderboard(store) + trial_board()
    (out / "leaderboard.md").write_text(text, encoding="utf-8")
    is_everything = not (scenario or estimator or effect or seeds or first_seed)
    if is_everything and out == DEFAULT_OUT and suite is Suite.QUICK:
        Path("leaderboard.md").write_text(text, encoding="utf-8")
    write_report(out, out / "report.html")
    scores = store.scores(summary.keys)
    screen.print(console.ranking_table(scores))
    trouble = console.trouble_table(scores)
    if trouble is not None:
        screen.print(trouble)
    counts = ", ".join(f"{count} {status}" for status, count in summary.statuses.items())
    typer.echo(f"{summary.computed} runs done, {summary.reused} kept from before ({counts}).")
    if summary.others:
        typer.echo(
            f"The files hold {summary.others} other {'run' if summary.others == 1 else 'runs'} of this folder too."
        )
    if summary.stale:
        typer.echo(console.stale_text(summary.stale))
    typer.echo(f"Written: {out}/scores.parquet, {out}/leaderboard.md, {out}/report.html")


def trial_board() -> str:
    """Return the part of leaderboard.md on the published trials of the diagnosis."""
    from fdbench.gap.trial.board import board, published

    return board(published())


@app.command()
def leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder of results.")] = DEFAULT_OUT,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit with 1 if the file would change.")
    ] = False,
    output: Annotated[Path, typer.Option("-o", "--output", callback=file_to_write, help="File to write.")] = Path(
        "leaderboard.md"
    ),
) -> None:
    """Write leaderboard.md from a folder of results."""
    from fdbench.benchmark import leaderboard as board
    from fdbench.benchmark.store import Store

    text = board.leaderboard(Store(existing(folder, "scores.parquet"))) + trial_board()
    if not check:
        output.write_text(text, encoding="utf-8")
        return
    difference = board.difference(text, output)
    if difference:
        typer.echo(difference)
        raise typer.Exit(1)


@app.command()
def compare(
    base: Annotated[Path, typer.Argument(help="Folder of results to compare with.")],
    new: Annotated[Path, typer.Argument(help="Folder of results that must not be worse.")],
    json_: Json = False,
    markdown: Annotated[
        Path | None, typer.Option(callback=file_to_write, help="File for a summary in Markdown.")
    ] = None,
    allow_missing: Annotated[bool, typer.Option("--allow-missing", help="Accept that NEW lacks rows of BASE.")] = False,
    gate_speed: Annotated[
        bool, typer.Option("--gate-speed", help="Judge times too; both must be of one machine and one FDBENCH_RUN_ID.")
    ] = False,
) -> None:
    """Compare two folders of results; exit with 1 where NEW is worse by more than chance and by more than matters."""
    from rich.console import Console

    from fdbench.benchmark import compare_text
    from fdbench.benchmark.compare import LOSS
    from fdbench.benchmark.compare import compare as compare_results
    from fdbench.benchmark.store import Store

    tables = (Store(existing(folder, "scores.parquet")).scores() for folder in (base, new))
    found = compare_results(*tables, allow_missing=allow_missing, gate_speed=gate_speed)
    if markdown is not None:
        markdown.write_text(compare_text.markdown(found), encoding="utf-8")
    if json_:
        echo_json(compare_text.document(found))
    else:
        Console().print(compare_text.terminal(found))
    if found.of(LOSS):
        raise typer.Exit(1)


def existing(folder: Path, file: str) -> Path:
    """Return a folder of results, or say that there are none in it."""
    if (folder / file).is_file():
        return folder
    if folder.is_file():
        raise SpecError(f"{folder}: a folder of results is expected, found a file.")
    if folder.is_dir():
        raise SpecError(f"{folder}: no {file} in this folder; `fdbench run --out {folder}` writes it.")
    others = [path.parent.name for path in folder.parent.glob(f"*/{file}")] if folder.parent.is_dir() else []
    hint = did_you_mean(folder.name, others) if others else f" `fdbench run --out {folder}` makes it."
    raise SpecError(f"{folder}: no such folder of results.{hint}")


@app.command()
def report(
    source: Annotated[Path, typer.Argument(help="Folder of results, or JSON file of `fdbench diagnose --json`.")],
    output: Html = Path("report.html"),
) -> None:
    """Write a page of results, or of the answer of a diagnosis: one HTML file that needs no network."""
    if source.is_file() or source.suffix == ".json":
        from fdbench.report.answer import write_answer

        write_answer(source, output)
    else:
        from fdbench.report import write_report

        write_report(existing(source, "scores.parquet"), output)


@app.command()
def record(
    scenario: Annotated[str, typer.Argument(help="Id or TOML file of a scenario.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", callback=file_to_write, help="File to write: .csv or .parquet.")
    ],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noises.")] = 0,
    effect: Effects = None,
) -> None:
    """Simulate a scenario and write its record, what a logger on the machine would have written."""
    from fdbench.scenario import load_scenario

    add_effects(effect)
    chosen = load_scenario(scenario)
    try:
        chosen.record(seed).save(output)
    except ArithmeticError as error:
        raise SpecError(f"{scenario}: these values cannot be computed with: {error}.") from error


@app.command()
def check(
    plugin: Annotated[str, typer.Argument(help="Name of an estimator, effect or scenario, or its file.")],
    effect: Effects = None,
) -> None:
    """Check an estimator, effect or scenario, such as your own file; exit with 1 where a check fails."""
    from fdbench.checks import check as run_checks
    from fdbench.effects import effects
    from fdbench.estimator import estimators
    from fdbench.registry import add_file, fault

    add_effects(effect)
    name = add_file(plugin, (estimators, effects)) if plugin.endswith(".py") else plugin
    try:
        lines = run_checks(name)
    except (Exception, SystemExit) as error:
        if isinstance(error, FdbenchError) and not isinstance(error, PluginError):
            raise
        text = str(error) if isinstance(error, PluginError) else f"{name}: {fault(error, Path(plugin).resolve())}"
        typer.echo(f"fdbench: {text}", err=True)
        raise typer.Exit(1) from error
    typer.echo("\n".join(lines))


@app.command()
def reproduce(
    paper: Annotated[str | None, typer.Argument(help="Name of a paper, such as mcpherson; default: all.")] = None,
    json_: Json = False,
) -> None:
    """Show each paper's figures beside ours; exit with 1 where a figure is outside its tolerance."""
    from fdbench.reproduce import run as run_reproduction

    rows = run_reproduction(paper)
    if json_:
        echo_json([row.as_dict() for row in rows])
    else:
        from fdbench.reproduce._table import show

        show(rows)
    if not all(row.ok for row in rows):
        raise typer.Exit(1)


@app.command()
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
    rehearse: Annotated[
        int,
        typer.Option(
            min=0,
            max=999,
            metavar="N",
            help="Learn the probabilities from N simulated cases of this machine, these motions and this noise; about "
            "3 s a case, kept for the next time. 80 are a good number.",
        ),
    ] = 0,
) -> None:
    """Say where the gap between a model and records lies, which effect causes it, and how far it shrinks."""
    from rich.console import Console

    from fdbench.gap.diagnose import diagnose as find
    from fdbench.gap.nominal import load_nominal
    from fdbench.gap.summary import summary
    from fdbench.reading import read_record
    from fdbench.record import Record

    def read(path: Path) -> Record:
        return read_record(path, data if path.suffix.lower() == ".toml" else None)

    if data is not None and not any(path.suffix.lower() == ".toml" for path in (*records, *(holdout or ()))):
        raise SpecError(f"--data {data}: a folder for mapping files (.toml), but no record is one.")
    if next_experiment is not None and next_experiment.suffix.lower() != ".csv":
        raise SpecError(f"--next-experiment {next_experiment}: the motion is written as .csv.")
    add_effects(effect)
    note = Console(stderr=True)
    with note.status("reading") as status:
        nominal = load_nominal(model)
        fitted, judged = ([read(path) for path in paths] for paths in (records, holdout or ()))
        heads = None
        if rehearse:
            from fdbench.gap.trial.rehearsal import rehearsed

            heads = rehearsed(nominal, fitted, judged, rehearse, status.update)
        found = find(nominal, fitted, judged, status.update, heads)
    if next_experiment is not None:
        from fdbench.gap.next_experiment import write_proposed

        found = write_proposed(found, next_experiment)
        if found.answer["next_experiment"] is None:
            typer.echo(f"fdbench: no causes in doubt that a motion would tell apart: no {next_experiment}.", err=True)
    if json_ is not None and str(json_) != "-":
        json_.write_text(json_text(found.answer) + "\n", encoding="utf-8")
    if html is not None:
        from fdbench.report.diagnosis import write_diagnosis

        write_diagnosis(found, html)
    if write_model is not None:
        from fdbench.gap.repaired import write_repaired

        write_repaired(found, write_model)
    if str(json_) == "-":
        echo_json(found.answer)
    else:
        typer.echo(summary(found))


trial = typer.Typer(
    help="Blind trials of the diagnosis: make records with sealed causes, answer, score.", no_args_is_help=True
)
app.add_typer(trial, name="trial")
Trial = Annotated[Path, typer.Argument(help="Folder of the trial; it never holds the key.")]


@trial.command("make")
def trial_make(
    folder: Trial,
    key: Annotated[Path, typer.Option(callback=writable, help="File for the key; keep it from whoever answers.")],
    tier: Annotated[
        str,
        typer.Option(
            help="A library's forms, B second implementation, C unlisted effects, D thin data, L to learn from."
        ),
    ] = "B",
    count: Annotated[int, typer.Option(min=1, max=999, help="Number of cases.")] = 20,
    nonce: Annotated[
        str | None, typer.Option(help="Hexadecimal digits of an opened key, to make a trial again.")
    ] = None,
) -> None:
    """Draw axes with withheld effects, record them, and seal what was planted."""
    from rich.console import Console

    from fdbench.gap.trial.make import make
    from fdbench.gap.trial.tiers import Tier

    if tier.upper() not in list(Tier):
        raise SpecError(f"tier: unknown tier '{tier}'.{did_you_mean(tier.upper(), list(Tier))}")
    with Console(stderr=True).status("making") as status:
        manifest = make(folder, key, Tier(tier.upper()), count, nonce, status.update)
    typer.echo(f"{len(manifest['cases'])} cases of tier {manifest['tier']} in {folder}; key in {key}.")


@trial.command("answer")
def trial_answer(
    folder: Trial,
    output: Annotated[Path, typer.Option("-o", "--output", callback=writable, help="JSON file of answers.")],
    diagnoser: Annotated[str, typer.Option(help="Name of a diagnoser, or its Python file.")] = "fdbench",
) -> None:
    """Diagnose every case from its records and model alone; write the answers and their SHA-256."""
    from rich.console import Console

    from fdbench.gap.trial.answer import answer
    from fdbench.gap.trial.diagnoser import diagnosers

    with Console(stderr=True).status("answering") as status:
        found = answer(folder, diagnosers.resolve(diagnoser), output, status.update)
    failed = sum(case["status"] != "ok" for case in found["cases"].values())
    typer.echo(f"{len(found['cases'])} cases answered by {found['diagnoser']}, {failed} failed: {output}")


@trial.command("score")
def trial_score(
    folder: Trial,
    answers: Annotated[Path, typer.Argument(help="JSON file of answers; its .sha256 lies beside it.")],
    key: Annotated[Path, typer.Option(help="File of the key.")],
    json_: Json = False,
) -> None:
    """Check every seal and print the score sheet, with bootstrap intervals over cases."""
    from fdbench.gap.trial.score import score, text

    found = score(folder, answers, key)
    if json_:
        echo_json(found)
    else:
        typer.echo(text(found))


@trial.command("learn")
def trial_learn(
    folder: Trial,
    output: Annotated[Path, typer.Option("-o", "--output", callback=writable, help="TOML file of what is learned.")],
    key: Annotated[Path, typer.Option(help="File of the key.")],
) -> None:
    """Learn from a trial of tier L how far the diagnosis can be trusted; its probabilities are drawn from that."""
    from rich.console import Console

    from fdbench.gap.trial.learn import KINDS, learn

    with Console(stderr=True).status("learning") as status:
        found = learn(folder, key, output, status.update)
    for kind in KINDS:
        own = [claim.right for claim in found if claim.kind == kind]
        typer.echo(f"{kind}: {len(own)} claims, {sum(own)} right")


def main() -> None:
    """Run the command line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if not sys.stdout.isatty():
        os.environ.setdefault("COLUMNS", WIDE)
    # Threads of the linear algebra only get in each other's way on small matrices.
    with threadpool_limits(1, user_api="blas"):
        app(prog_name="fdbench")


if __name__ == "__main__":
    main()
