"""The command line: what all commands have in common; the commands are in `fdbench.commands`."""

import os
import sys
from io import TextIOWrapper
from typing import Annotated, Any, NoReturn

import typer
from threadpoolctl import threadpool_limits
from typer.core import TyperGroup

from fdbench.commands.check import check
from fdbench.commands.compare import compare
from fdbench.commands.diagnose import diagnose
from fdbench.commands.evaluate import evaluate
from fdbench.commands.import_ import import_
from fdbench.commands.leaderboard import leaderboard
from fdbench.commands.list import list_
from fdbench.commands.new import new
from fdbench.commands.plot import plot
from fdbench.commands.record import record
from fdbench.commands.report import report
from fdbench.commands.reproduce import reproduce
from fdbench.commands.run import run
from fdbench.commands.show import show
from fdbench.commands.trial import trial
from fdbench.commands.verify import verify
from fdbench.errors import FdbenchError, brief, printable
from fdbench.version import __version__

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
            sys.stdout.flush()
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
            let_go_of_output()
            refuse(f"fdbench: {f'{error.filename}: ' if error.filename else ''}{error.strerror}.")
        except MemoryError as error:
            refuse(f"fdbench: not enough memory for this input: {error}")
        if code == INTERRUPTED:
            typer.echo("fdbench: interrupted; what is finished is kept.", err=True)
        sys.exit(code)


def let_go_of_output() -> None:
    """Give up what cannot be written, which the interpreter would try once more at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def refuse(message: str) -> NoReturn:
    """Say what is wrong and exit with 2."""
    typer.echo(brief(printable(message, in_lines=True)), err=True)
    sys.exit(2)


app = typer.Typer(
    name="fdbench",
    cls=Commands,
    help="Benchmark of machine-tool feed drives: simulate, estimate, score, diagnose. Begin with 'fdbench run'.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def say_version(asked: bool) -> None:
    """Print the version and exit."""
    if asked:
        typer.echo(f"fdbench {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=say_version, help="Show the version and exit.")
    ] = False,
) -> None:
    """Take what stands before a command."""


app.command("list")(list_)
app.command("import")(import_)
for command in (
    run,
    leaderboard,
    verify,
    compare,
    report,
    record,
    plot,
    show,
    new,
    check,
    reproduce,
    diagnose,
    evaluate,
):
    app.command()(command)
app.add_typer(trial, name="trial")


def main() -> None:
    """Run the command line."""
    # Those closed by who started this: a file that is opened must not take their place.
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "r" if name == "stdin" else "w"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if not sys.stdout.isatty():
        os.environ.setdefault("COLUMNS", WIDE)
    # Threads of the linear algebra only get in each other's way on small matrices.
    with threadpool_limits(1, user_api="blas"):
        app(prog_name="fdbench")
