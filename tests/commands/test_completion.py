"""What a shell completes: commands, options, and the names of what is installed."""

import subprocess
import sys
from collections.abc import Callable

import pytest
from typer.testing import CliRunner

from fdbench.cli import app

SHELLS: dict[str, Callable[[str], dict[str, str]]] = {
    "bash": lambda words: {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)},
    "zsh": lambda words: {"_TYPER_COMPLETE_ARGS": words},
    "fish": lambda words: {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
}


def completed(shell: str, words: str) -> str:
    environment = {"_FDBENCH_COMPLETE": f"complete_{shell}", **SHELLS[shell](words)}
    return CliRunner(env=environment).invoke(app, [], prog_name="fdbench").stdout


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("fdbench rec", "record"),
        ("fdbench run --estimator krl", "krls_t"),
        ("fdbench run --scenario ShakerC", "ShakerConstant-v2"),
        ("fdbench record ShakerC", "ShakerConstant-v2"),
        ("fdbench show parameter_e", "parameter_error"),
        ("fdbench check lugre", "lugre_friction"),
        ("fdbench trial answer folder --diagnoser largest", "largest_correlation"),
        ("fdbench new est", "estimator"),
    ],
)
def test_names_complete(shell: str, words: str, name: str) -> None:
    assert name in completed(shell, words)
    assert "residual_" not in completed(shell, words)


def test_a_shell_takes_the_script() -> None:
    """In a bash that has loaded it, the names come as when the tab key is pressed."""
    program = f"""
        PATH={sys.prefix}/bin:$PATH
        source <(_FDBENCH_COMPLETE=source_bash fdbench)
        COMP_WORDS=(fdbench run --estimator krl) COMP_CWORD=3
        $(complete -p fdbench | sed -E 's/.*-F (\\S+).*/\\1/') fdbench
        echo "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == (["krls_t"], "")
