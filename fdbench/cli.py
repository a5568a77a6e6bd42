"""The command line; every command imports what it needs when it runs, so that ``fdbench list`` is quick."""

import json
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fdbench.errors import FdbenchError, SpecError

if TYPE_CHECKING:
    pass

# Threads of the linear algebra only get in the way of processes, and small matrices are faster without.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

app = typer.Typer(
    help="Benchmark of machine-tool feed drives: simulate, estimate, score, diagnose.",
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

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def echo_json(value: object) -> None:
    """Print a value as JSON on standard output."""
    typer.echo(json.dumps(value, indent=2, ensure_ascii=False))


@app.command("list")
def list_(kind: Kind, json_: Json = False) -> None:
    """List scenarios, estimators, effects or metrics, with one line on each."""
    rows = _scenario_rows() if kind is Kind.SCENARIOS else _plugin_rows(kind)
    if json_:
        echo_json(rows)
        return
    width = max((len(row["name"]) for row in rows), default=0)
    for row in rows:
        typer.echo(f"{row['name']:{width}}  {row['summary']}")


def _scenario_rows() -> list[dict[str, str]]:
    import tomllib

    from fdbench.catalogue import scenario_files

    titles = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")).get("title", "") for path in scenario_files()}
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
    suite: Annotated[Suite, typer.Option(help="Which scenarios, unless --scenario names some.")] = Suite.QUICK,
    scenario: Annotated[list[str] | None, typer.Option(help="Id or TOML file; may be repeated.")] = None,
    estimator: Annotated[list[str] | None, typer.Option(help="Name or Python file; may be repeated.")] = None,
    seeds: Annotated[int | None, typer.Option(min=1, help="Number of seeds; quick: 3, full: 10.")] = None,
    first_seed: Annotated[int, typer.Option(min=0, help="First seed; the others follow it.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of results; finished runs in it are kept.")] = DEFAULT_OUT,
    keep_estimates: Annotated[bool, typer.Option(help="Keep the raw estimates of all seeds.")] = False,
) -> None:
    """Run estimators on scenarios, score and rank them; what is finished is not run again."""
    from rich.console import Console

    from fdbench.benchmark import console, leaderboard
    from fdbench.benchmark.run import run as run_benchmark
    from fdbench.benchmark.run import select
    from fdbench.benchmark.store import Store
    from fdbench.catalogue import suite_members
    from fdbench.estimator import estimators
    from fdbench.report import write_report

    chosen = scenario or suite_members(suite.value)
    names = [*select(estimator)] if estimator else estimators.names()
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
    text = leaderboard.leaderboard(store)
    (out / "leaderboard.md").write_text(text, encoding="utf-8")
    is_everything = not scenario and not estimator and seeds is None and first_seed == 0
    if is_everything and out == DEFAULT_OUT and suite is Suite.QUICK:
        Path("leaderboard.md").write_text(text, encoding="utf-8")
    write_report(out, out / "report.html")
    screen.print(console.ranking_table(store))
    trouble = console.trouble_table(store)
    if trouble is not None:
        screen.print(trouble)
    counts = ", ".join(f"{count} {status}" for status, count in summary.statuses.items())
    screen.print(f"{summary.computed} runs done, {summary.reused} kept from before ({counts}).")
    screen.print(f"Written: {out}/scores.parquet, {out}/leaderboard.md, {out}/report.html", soft_wrap=True)


@app.command()
def leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder of results.")] = DEFAULT_OUT,
    check: Annotated[bool, typer.Option("--check", help="Exit with 1 if leaderboard.md would change.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")] = Path("leaderboard.md"),
) -> None:
    """Write leaderboard.md from stored results."""
    from fdbench.benchmark import leaderboard as board
    from fdbench.benchmark.store import Store

    text = board.leaderboard(Store(existing(folder, "scores.parquet")))
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
    markdown: Annotated[Path | None, typer.Option(help="File for a summary in Markdown.")] = None,
    allow_missing: Annotated[bool, typer.Option("--allow-missing", help="Let NEW lack rows of BASE.")] = False,
    gate_speed: Annotated[bool, typer.Option("--gate-speed", help="Judge times too; needs one run.")] = False,
) -> None:
    """Exit with 1 where results got worse by more than chance and by more than matters."""
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
    if not (folder / file).is_file():
        raise SpecError(f"{folder}: no {file} in this folder; `fdbench run --out {folder}` makes it.")
    return folder


@app.command()
def report(
    source: Annotated[Path, typer.Argument(help="Folder of results.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="HTML file to write.")] = Path("report.html"),
) -> None:
    """Write a self-contained HTML page of results."""
    from fdbench.report import write_report

    write_report(existing(source, "scores.parquet"), output)


@app.command()
def record(
    scenario: str,
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .csv or .parquet.")],
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Simulate a scenario and write what a logger would have written."""
    from fdbench.scenario import load_scenario

    load_scenario(scenario).record(seed).save(output)


@app.command()
def check(plugin: Annotated[str, typer.Argument(help="Name of a plug-in, or its file.")]) -> None:
    """Run the shared checks on an estimator, effect or scenario."""
    from fdbench.checks import check as run_checks

    try:
        for line in run_checks(plugin):
            typer.echo(line)
    except FdbenchError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from error


@app.command()
def reproduce(
    paper: Annotated[str | None, typer.Argument(help="Module of a paper, such as mcpherson.")] = None,
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
    model: Annotated[Path, typer.Option(help="Model TOML, or a scenario file whose [plant] is taken.")],
    holdout: Annotated[list[Path] | None, typer.Option(help="Record to judge on; may be repeated.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the files that mapping TOMLs name.")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="File for the answer as JSON; - prints it.")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="File for the report with plots.")] = None,
    write_model: Annotated[Path | None, typer.Option(help="File for the repaired model as TOML.")] = None,
) -> None:
    """Say where the gap between a model and records lies, which effect causes it, and how far it shrinks."""
    from rich.console import Console

    from fdbench.gap.diagnose import diagnose as find
    from fdbench.gap.nominal import load_nominal
    from fdbench.gap.summary import summary
    from fdbench.reading import read_record

    def read(path: Path) -> object:
        return read_record(path, data if path.suffix == ".toml" else None)

    note = Console(stderr=True)
    with note.status("reading") as status:
        found = find(
            load_nominal(model),
            [read(path) for path in records],  # type: ignore[misc]
            [read(path) for path in holdout or ()],  # type: ignore[misc]
            status.update,
        )
    if json_ is not None and str(json_) != "-":
        json_.write_text(json.dumps(found.answer, indent=2), encoding="utf-8")
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


def main() -> None:
    """Run the command line: 0 good, 1 a check failed, 2 bad usage or bad input with one message."""
    try:
        app(standalone_mode=True)
    except FdbenchError as error:
        typer.echo(f"fdbench: {error}", err=True)
        sys.exit(2)
    except KeyboardInterrupt:
        typer.echo("fdbench: interrupted; what is finished is kept.", err=True)
        sys.exit(130)


if __name__ == "__main__":
    main()
