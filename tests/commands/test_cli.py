"""The command line: bad input ends with exit code 2 and one message, a failed check with 1, and output is clean."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.catalogue import scenario_folder
from fdbench.commands.list import Listed
from fdbench.effects import effects
from fdbench.errors import RecordError
from fdbench.estimator import estimators
from fdbench.reading import read_record
from fdbench.report.written import write_changed
from fdbench.scenario import load_scenario

PROGRAM = [sys.executable, "-m", "fdbench"]
RUN = ["run", "--scenario", "ShakerConstant-v1", "--seeds", "1", "--jobs", "1"]
MODEL = str(scenario_folder() / "BallScrewAxis-v0.toml")

ESTIMATOR = '''import numpy as np
from fdbench.estimator import BatchEstimator, Estimate


class MeanForce(BatchEstimator):
    """Takes the mean of the target for the prediction."""

    def fit(self, context, record):
        target = context.regression(record).target
        parameters = dict.fromkeys(context.nominal, 0.5)
        return Estimate(parameters=parameters, output=np.full(len(target), target.mean()))
'''

EFFECT = """from dataclasses import dataclass
from typing import final

from fdbench.effects import Effect, Port
from fdbench.effects._effect import kernel, parameter


@final
@dataclass(frozen=True, kw_only=True)
class SquareSpring(Effect):
    port = Port.TABLE_FORCE
    amplitude = "stiffness_N_per_m2"

    stiffness_N_per_m2: float = parameter("k", low=0.0, high=1e5, typical=1e3)

    @kernel
    def kernel(t, h, x, v, u, k):
        return k * x * abs(x), 2.0 * k * abs(x) * h
"""


@pytest.fixture(autouse=True)
def _own_plugins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let no plug-in file of one test be known to another, and no file be written outside."""
    for registry in (estimators, effects):
        monkeypatch.setattr(registry, "_files", {})
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small run, under a name that is not plain."""
    folder = tmp_path_factory.mktemp("fdbench") / "Ergebnisse [größer]"
    done = run(*RUN, "--estimator", "least_squares", "--out", folder)
    assert done.exit_code == 0, done.output
    return folder


def run(*arguments: object) -> Result:
    """Run a command in this process; an exception that reaches the user fails the test."""
    result = CliRunner().invoke(cli.app, [str(item) for item in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def refused(*arguments: object) -> str:
    """Return the one line on standard error of a command that is refused with exit code 2."""
    result = run(*arguments)
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("fdbench")
    assert result.stderr.count("\n") == 1
    return result.stderr


def start(*arguments: object, program: Sequence[str] = PROGRAM, **options: Any) -> "subprocess.Popen[str]":
    """Start a command in a process of its own."""
    words = [*program, *map(str, arguments)]
    return subprocess.Popen(words, text=True, stderr=subprocess.PIPE, **{"stdout": subprocess.PIPE, **options})


def write(name: str, text: str) -> Path:
    path = Path(name)
    path.write_text(text, "utf-8")
    return path


# ---- bad usage ----


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("list scenario", r"'scenario' is not one of 'scenarios', 'estimators', 'effects', 'metrics', .*\. Try"),
        ("list effects --jsn", r"No such option: --jsn .*--json"),
        ("lst", r"No such command 'lst'\. Did you mean 'list'\?"),
        ("run --seeds 0", r"fdbench run: .*'--seeds': .*greater than or equal to 1"),
        ("run --seeds two", r"'--seeds': .*integer"),
        ("run --first-seed -1", r"'--first-seed': .*greater than or equal to 0"),
        ("run --seeds 99999999999", r"seeds 99999999999: at least 1 and at most 10000"),
        ("run --first-seed 99999999999999999999", r"first seed 9+: at least 0 and at most"),
        ("run --jobs 99999999999", r"jobs 99999999999: at least 1 and at most 1024"),
        ("run --scenario ShakerConstant-v0 --estimator loop.py", r"loop\.py: no such file"),
        ("record loop.toml -o a.csv", r"loop\.toml: cannot be read: "),
        ("run --jobs 0", r"'--jobs': .*greater than or equal to 1"),
        ("run --suite quik", r"'quik' is not one of 'quick', 'full'"),
        ("run --scenario Shaker", r"unknown scenario 'Shaker'\. Did you mean Shaker\w+-v[012]\?"),
        ("run --scenario shakerconstant", r"Did you mean ShakerConstant-v[012]\?"),
        ("run --scenario none.toml", r"none\.toml: cannot be read: no such file"),
        ("run --scenario ShakerConstant-v0 --scenario fdbench/ShakerConstant-v0", r"is given 2 times"),
        ("run --scenario ShakerConstant-v0 --estimator least_square", r"Did you mean least_squares\?"),
        ("run --scenario ShakerConstant-v0 --estimator none.py", r"none\.py: no such file"),
        ("run --scenario ShakerConstant-v0 --effect none.py", r"none\.py: no such file"),
        ("run --out file.txt", r"file\.txt: cannot be made: .*file\.txt is a file, not a folder"),
        ("run --out file.txt/deep/out", r"cannot be made: .*file\.txt is a file, not a folder"),
        ("reproduce mcferson", r"unknown paper 'mcferson'\. Did you mean mcpherson\?"),
        ("leaderboard", r"results: no such folder of results\. `fdbench run --out results` makes it"),
        ("leaderboard folder", r"folder: no scores\.parquet in this folder; `fdbench run --out folder` writes it"),
        ("leaderboard --check folder", r"folder: no scores\.parquet"),
        ("report", r"Missing argument 'source'"),
        (
            "report file.txt",
            r"file\.txt: neither a folder of results nor an answer of `fdbench diagnose --json`: .*not JSON: Expecting",
        ),
        ("report answer.json", r"answer\.json: neither a folder .*gap: missing key"),
        ("report binary.toml", r"binary\.toml: neither a folder .*: 'utf-8' codec can't decode"),
        ("leaderboard answer.json", r"answer\.json: a folder of results is expected, found a file"),
        ("report none.json", r"none\.json: .*No such file"),
        ("report folder -o -", r"-: the name of a file is expected here"),
        ("leaderboard folder -o -", r"-: the name of a file is expected here"),
        ("compare folder folder --markdown -", r"-: the name of a file is expected here"),
        ("report folder -o none/report.html", r"none/report\.html: cannot be written: there is no folder none"),
        ("compare folder", r"Missing argument 'new'"),
        ("compare folder none", r"folder: no scores\.parquet"),
        ("record ShakerConstant-v0", r"fdbench record: Missing option '-o' / '--output'"),
        ("record ShakerConst-v0 -o a.csv", r"Did you mean ShakerConstant-v[012]\?"),
        ("record ShakerConstant-v0 -o a.csv --seed -1", r"'--seed': .*greater than or equal to 0"),
        ("record ShakerConstant-v0 -o none/a.csv", r"there is no folder none"),
        ("record ShakerConstant-v0 -o folder", r"folder: a folder, where a file to write is expected"),
        (
            "record ShakerConstant-v0 -o a.txt",
            r"a\.txt: a record cannot be written as '\.txt'\. Allowed: \.csv, \.parq",
        ),
        ("check", r"Missing argument 'plugin'"),
        ("check least_square", r"unknown plug-in 'least_square'\. Did you mean least_squares\?"),
        ("check zzz", r"unknown plug-in 'zzz'\. Nearest of the \d+ that are allowed: "),
        ("check none.py", r"none\.py: no such file"),
        ("check folder.py", r"folder\.py: a folder, not a plug-in file"),
        ("check none.toml", r"none\.toml: cannot be read: no such file"),
        ("diagnose", r"Missing argument 'records'"),
        ("diagnose axis.csv", r"Missing option '--model'"),
        ("diagnose axis.csv --model none.toml", r"none\.toml: cannot be read: no such file"),
        ("diagnose axis.csv --model folder", r"folder: cannot be read: "),
        ("diagnose axis.csv --model binary.toml", r"binary\.toml: not valid TOML"),
        ("diagnose axis.csv --model MODEL --html none/a.html", r"there is no folder none"),
        ("diagnose axis.csv --model MODEL --json folder", r"folder: a folder, where a file"),
        ("diagnose axis.csv --model MODEL --data folder", r"data folder: a folder for mapping files"),
        ("diagnose axis.csv --model MODEL --effect none.py", r"none\.py: no such file"),
        ("diagnose axs.csv --model MODEL", r"axs\.csv: no such file.*axis\.csv"),
        ("diagnose folder --model MODEL", r"folder: "),
        ("diagnose axis.csv --model MODEL", r"axis\.csv: the file is empty"),
        ("diagnose axis.csv --model MODEL --holdout none.csv", r"axis\.csv: the file is empty"),
    ],
)
def test_bad_usage_is_told_in_one_message(arguments: str, message: str) -> None:
    write("file.txt", "")
    write("answer.json", "{}")
    write("axis.csv", "")
    Path("binary.toml").write_bytes(bytes(range(128, 256)))
    for name in ("folder", "folder.py"):
        Path(name).mkdir()
    for name in ("loop.py", "loop.toml"):
        Path(name).symlink_to(name)
    words = [MODEL if word == "MODEL" else word for word in arguments.split()]
    assert re.search(message, refused(*words))
    assert sorted(path.name for path in Path().iterdir()) == sorted(
        ["file.txt", "answer.json", "axis.csv", "binary.toml", "folder", "folder.py", "loop.py", "loop.toml"]
    )


def test_no_command_shows_the_commands() -> None:
    result = run()
    assert (result.exit_code, result.stderr) == (2, "fdbench: A command is missing. Try 'fdbench --help'.\n")
    assert "diagnose" in result.stdout


def test_every_command_has_help() -> None:
    listed = run("--help")
    names = {command.name or command.callback.__name__ for command in cli.app.registered_commands}  # type: ignore[union-attr]
    assert {"list", "list_"} & names
    for name in names - {"list_"} | {"list"}:
        assert re.search(rf"│ {name}\b", listed.stdout), name
        described = run(name, "--help")
        assert (described.exit_code, described.stderr) == (0, "")


def test_a_folder_without_the_right_to_write_is_refused(monkeypatch: pytest.MonkeyPatch, results: Path) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)
    assert "a.csv: cannot be written: permission denied" in refused("record", "ShakerConstant-v0", "-o", "a.csv")
    assert "out: cannot be written: permission denied" in refused(*RUN, "--out", "out")
    assert "leaderboard.md: cannot be written: permission denied" in refused("leaderboard", results)


def test_faults_of_the_machine_are_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(error: BaseException) -> Any:
        def raising(*_: object) -> None:
            raise error

        return raising

    for error, message in (
        (PermissionError(13, "Permission denied", "a.toml"), "fdbench: a.toml: Permission denied."),
        (OSError(28, "No space left on device"), "fdbench: No space left on device."),
        (MemoryError("9 TiB"), "fdbench: not enough memory for this input: 9 TiB"),
        (OverflowError("too large"), "fdbench: X-v0: these values cannot be computed with: too large."),
    ):
        with monkeypatch.context() as patch:
            patch.setattr("fdbench.scenario.load_scenario", lambda name, e=error: SimpleNamespace(record=fail(e)))
            assert refused("record", "X-v0", "-o", "a.csv") == message + "\n"


# ---- plug-in files ----

BODY = ESTIMATOR[ESTIMATOR.index("        target = ") :].rstrip("\n")


def estimator(name: str, *changes: tuple[str, str]) -> Path:
    text = ESTIMATOR
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return write(name, text)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("import numpy as np", "import nothing_of_this_name")], r"line 1: ModuleNotFoundError: No module named"),
        ([("def fit(self, ", "def fit(self; ")], r"line 8: SyntaxError"),
        ([("class MeanForce", "1 / 0\nclass MeanForce")], r"line 5: ZeroDivisionError"),
        ([("def fit", "def fitt")], r"exactly one Estimator, found MeanForce, which lacks fit"),
        ([("(BatchEstimator)", "")], r"a class derived from Estimator or Effect, found none"),
        ([(BODY, BODY + "\n\n\nclass Other(MeanForce):\n    pass")], r"exactly one Estimator, found MeanForce, Other"),
    ],
)
def test_a_file_that_is_no_plugin_is_refused(changes: list[tuple[str, str]], message: str) -> None:
    file = estimator("mean_force.py", *changes)
    assert re.search(rf"mean_force\.py: .*{message}", refused("check", file))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            [("def fit", "def __init__(self):\n        raise ValueError('no luck')\n\n    def fit")],
            r"mean_force\.py:9: ValueError: no luck",
        ),
        ([("def fit", "def __init__(self, p):\n        pass\n\n    def fit")], "missing 1 required positional"),
        ([("def fit", "def skip(self, context):\n        return context.mass\n\n    def fit")], "no attribute 'mass'"),
        (
            [(BODY, "        raise RuntimeError('no luck')")],
            r"returns_estimate: mean_force\.py:9: RuntimeError: no luck",
        ),
        ([(BODY, "        raise SystemExit(0)")], r"returns_estimate: mean_force\.py:9: SystemExit: 0"),
        (
            [(BODY, "        return {'mass_kg': 1.0}")],
            r"returns_estimate: mean_force\.py:8: PluginError: fit returned a dict, expected an Estimate",
        ),
        ([("len(target)", "3")], r"returns_estimate: output has shape \(3,\), expected \(\d+,\)"),
        ([("target.mean()", "np.nan")], "returns_estimate: output holds nan in row 0"),
        ([("target.mean()", "np.random.rand()")], "is_deterministic: two runs on the same record differ"),
        ([("target = ", "record['time_s'][0] = 1.0; target = ")], "assignment destination is read-only"),
        ([("def fit(self, context, record)", "def fit(self, record)")], r"fit\(\) takes 2 positional arguments"),
        ([('"""Takes the mean of the target for the prediction."""', "")], "has_docstring: "),
    ],
)
def test_a_plugin_that_breaks_its_contract_fails_the_check(changes: list[tuple[str, str]], message: str) -> None:
    result = run("check", estimator("mean_force.py", *changes))
    assert result.exit_code == 1
    assert result.stderr.startswith("fdbench: mean_force: ")
    assert re.search(message, result.stderr)


@pytest.mark.parametrize("name", ["mean_force.py", "mean-force 2.py", "mittlere_größe.py"])
def test_an_estimator_of_twelve_lines_passes_the_check(name: str) -> None:
    result = run("check", write(name, ESTIMATOR))
    assert (result.exit_code, result.stderr) == (0, "")
    assert all(line.endswith(": ok") for line in result.stdout.splitlines())
    assert "can_be_pickled: ok" in result.stdout


def test_a_failed_run_is_a_row_with_a_reason() -> None:
    faults = {
        "raises": (BODY, "        raise RuntimeError('no luck')"),
        "leaves": (BODY, "        raise SystemExit(0)"),
        "wrong_kind": (BODY, "        return 5"),
        "wrong_shape": ("len(target)", "3"),
        "no_number": ("target.mean()", "np.nan"),
        "changes": ("target = ", "record['time_s'][0] = 1.0; target = "),
        "no_default": ("def fit", "def __init__(self, p):\n        pass\n\n    def fit"),
        "good": ("MeanForce", "MeanForce"),
    }
    files = [item for name, change in faults.items() for item in ("--estimator", estimator(f"{name}.py", change))]
    result = run(*RUN, "--no-report", "--out", "out", *files)
    assert (result.exit_code, result.stderr) == (0, "")
    scores = pd.read_parquet("out/scores.parquet")
    found = {name: group for name, group in scores.groupby("estimator") if name in faults}
    assert set(found) == set(faults)
    assert set(found.pop("good")["status"]) == {"ok", "skipped"}
    reasons = ("no luck", "SystemExit", "fit returned a int", "shape (3,)", "nan", "read-only", "positional argument")
    for name, reason in zip(faults, reasons, strict=False):
        assert set(found[name]["status"]) == {"failed"}, name
        assert found[name]["message"].str.contains(reason, regex=False).all(), name
        assert name in result.stdout
    assert f"{len(reasons)} failed" in result.stdout


def test_two_files_of_one_name_are_refused() -> None:
    for folder in ("a", "b"):
        Path(folder).mkdir()
        write(f"{folder}/mean_force.py", ESTIMATOR)
    arguments = [*RUN, "--estimator", "a/mean_force.py", "--estimator"]
    assert "a/mean_force.py and b/mean_force.py: two plug-ins of one name" in refused(*arguments, "b/mean_force.py")
    assert "the name null belongs to the estimator" in refused(*arguments, write("null.py", ESTIMATOR))
    assert "'oracle': this name is the benchmark's own" in refused(*arguments, write("oracle.py", ESTIMATOR))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("u, k):", "u, p):", r"the kernel takes \(t, h, x, v, u, p\), but .* \(t, h, x, v, u, k\)"),
        ("u, k):", "k):", r"the kernel takes \(t, h, x, v, k\), but .* \(t, h, x, v, u, k\)"),
        ("    port = Port.TABLE_FORCE\n", "", r"SquareSpring lacks the class attribute port"),
        ("Port.TABLE_FORCE", "'table_force'", r"'str' object has no attribute 'is_force'"),
        ('amplitude = "stiffness_N_per_m2"', 'amplitude = "stiffness"', r"amplitude stiffness is not one of the param"),
        ("@dataclass(frozen=True, kw_only=True)\n", "", r"must be a frozen keyword-only dataclass"),
        ("    @kernel\n", "", r"no attribute 'py_func'"),
        ("return k * x", "return p * x", r"NameError: name 'p' is not defined"),
        ("k * x * abs(x), ", "x / (v - v), ", r"returns_finite_values: the kernel returns"),
        (", 2.0 * k", ", -2.0 * k", r"the slope .* is negative"),
        ("import final", "import finally_", r"line 2: ImportError"),
    ],
)
def test_an_effect_that_does_not_fit_is_refused(old: str, new: str, message: str) -> None:
    assert old in EFFECT
    file = write("square_spring.py", EFFECT.replace(old, new))
    for command in (
        ["record", "ShakerConstant-v0", "-o", "a.csv", "--effect", file],
        [*RUN, "--effect", file],
        ["diagnose", "axis.csv", "--model", MODEL, "--effect", file],
    ):
        assert re.search(rf"square_spring\.py: .*{message}", refused(*command))


def test_an_effect_by_path_acts_in_records_and_in_other_processes() -> None:
    text = (scenario_folder() / "ShakerConstant-v0.toml").read_text("utf-8")
    own = '[[reality.effects]]\nkind = "square_spring"\nstiffness_N_per_m2 = 9e4\n\n[[reality.effects]]'
    scenario = write("Eigener-v0.toml", text.replace("[[reality.effects]]", own, 1))
    file = write("square_spring.py", EFFECT)
    assert "reality.effects[0].kind: unknown effect 'square_spring'" in refused("record", scenario, "-o", "a.csv")
    assert run("record", scenario, "-o", "a.csv", "--effect", file).exit_code == 0
    with_spring, plain = read_record("a.csv"), load_scenario("ShakerConstant-v0").record(0)
    assert not np.array_equal(with_spring["motor_force_N"], plain["motor_force_N"])

    arguments = ["--scenario", scenario, "--effect", file, "--estimator", write("schätzer.py", ESTIMATOR)]
    result = run("run", *arguments, "--seeds", "2", "--jobs", "2", "--no-report", "--out", "größe")
    assert (result.exit_code, result.stderr) == (0, "")
    assert set(pd.read_parquet("größe/scores.parquet")["status"]) == {"ok", "skipped"}


def test_an_effect_by_path_is_a_candidate_of_the_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    load_scenario("BallScrewAxis-v0").record(0).save("axis.parquet")
    library: list[str] = []

    def seen(nominal: Any, *_: object) -> None:
        library.extend(kind.name for kind in nominal.library)
        raise RecordError("seen.")

    monkeypatch.setattr("fdbench.api._diagnosis.find", seen)
    arguments = ["diagnose", "axis.parquet", "--model", MODEL, "--effect", write("square_spring.py", EFFECT)]
    assert refused(*arguments) == "fdbench: seen.\n"
    assert "square_spring" in library


# ---- scenarios and data ----


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "mass_kg = 20.0",
            "mas_kg = 20.0",
            r"Own-v0\.toml: scenario\.plant\.motor\.mas_kg: .*Did you mean mass_kg \[kg\]",
        ),
        ("mass_kg = 20.0", "mass_g = 20000.0", r"plant\.motor\.mass_g: unknown key .*Did you mean mass_kg \[kg\]\?"),
        ("mass_kg = 20.0", "mass_kg = -20.0", r"plant\.motor\.mass_kg: -20 is outside \(0, inf\) kg"),
        ("mass_kg = 20.0", 'mass_kg = "20"', r"a number in kg is expected, found the text '20'"),
        ('kind = "shaker_force"', 'kind = "shaker"', r"unknown effect 'shaker'\. Did you mean shaker_force\?"),
        ("[timing]", "[timing", r"not valid TOML: .*line"),
    ],
)
def test_a_faulty_scenario_is_refused_by_every_command(old: str, new: str, message: str) -> None:
    text = (scenario_folder() / "ShakerConstant-v0.toml").read_text("utf-8")
    assert old in text
    file = write("Own-v0.toml", text.replace(old, new, 1))
    for command in (["run", "--scenario", file], ["record", file, "-o", "a.csv"], ["check", file]):
        assert re.search(message, refused(*command))


def test_absent_data_give_a_row_that_says_where_to_get_and_to_put_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FDBENCH_DATA", str(tmp_path))
    measured = load_scenario("EMPS-v0").measured
    assert measured is not None
    result = run("run", "--scenario", "EMPS-v0", "--estimator", "least_squares", "--jobs", "1", "--out", "out")
    assert (result.exit_code, result.stderr) == (1, "")
    assert result.stdout.endswith("No run went well, null and oracle apart: 1 skipped.\n")
    scores = pd.read_parquet("out/scores.parquet")
    assert set(scores["status"]) == {"skipped"}
    assert "No ranking: no scenario has a run that can be scored." in result.stdout
    assert f"EMPS-v0 was skipped. {tmp_path}" in " ".join(result.stdout.split())
    for message in scores["message"]:
        assert measured.obtain in message
        assert str(tmp_path / "emps" / "DATA_EMPS.mat") in message
    for command in (["record", "EMPS-v0", "-o", "a.csv"], ["check", "EMPS-v0"]):
        assert measured.obtain in refused(*command)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.002,0.0,0.0,0.0", "0.002,,0.0,0.0", r"axis\.csv: line 4, column reference_position_m: the cell is empty"),
        ("0.002,0.0,0.0,0.0", "0.002,none,0.0,0.0", r"line 4, column reference_position_m: 'none' is not a number"),
        (",", ";", r"has no ',' but ';' between its names.*delimiter = \";\""),
        ("position_m,", "position_mm,", r"unknown column 'reference_position_mm'"),
        ("time_s", "t", r"unknown column 't'"),
        ("0.002,", "0.022,", r"axis\.csv: time_s "),
    ],
)
def test_a_faulty_record_is_refused(old: str, new: str, message: str) -> None:
    lines = ["time_s,reference_position_m,position_m,motor_force_N", *(f"{n / 1000},0.0,0.0,0.0" for n in range(5))]
    file = write("axis.csv", "\n".join(lines).replace(old, new))
    assert re.search(message, refused("diagnose", file, "--model", MODEL))


# ---- output ----


@pytest.mark.parametrize("kind", list(Listed))
def test_lists_are_valid_json(kind: Listed) -> None:
    result = run("list", kind, "--json")
    rows = json.loads(result.stdout)
    assert (result.exit_code, result.stderr) == (0, "")
    assert all(row["name"] and row["summary"] for row in rows)
    assert [row["name"] for row in rows] == sorted(row["name"] for row in rows)
    assert all(row["name"] in line for row, line in zip(rows, run("list", kind).stdout.splitlines(), strict=True))


def test_list_alone_counts_what_can_be_listed() -> None:
    result = run("list")
    assert (result.exit_code, result.stderr) == (0, "")
    found = {
        name: (int(count), words) for name, count, words in (line.split(None, 2) for line in result.stdout.splitlines())
    }
    assert list(found) == list(Listed)
    for kind, (count, words) in found.items():
        assert count == len(run("list", kind).stdout.splitlines())
        assert words
    assert json.loads(run("list", "--json").stdout)[0]["count"] == found["scenarios"][0]


def test_the_version_is_said() -> None:
    result = run("--version")
    assert (result.exit_code, result.stdout, result.stderr) == (0, f"fdbench {version('fdbench')}\n", "")


def test_json_has_no_number_that_json_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    def unlike_json(word: str) -> None:
        raise ValueError(word)

    answer = {"gap": {"before": float("inf")}, "causes": [{"share": float("nan")}, {"share": 0.5}], "größe": (1, None)}
    expected = {"gap": {"before": None}, "causes": [{"share": None}, {"share": 0.5}], "größe": [1, None]}
    load_scenario("BallScrewAxis-v0").record(0).save("axis.parquet")
    found = SimpleNamespace(answer=SimpleNamespace(as_json=lambda: answer))
    monkeypatch.setattr("fdbench.api._diagnosis.find", lambda *_: found)
    result = run("diagnose", "axis.parquet", "--model", MODEL, "--json", "-")
    assert (result.exit_code, result.stderr) == (0, "")
    assert json.loads(result.stdout, parse_constant=unlike_json) == expected
    monkeypatch.setattr("fdbench.api._diagnosis.summary", lambda found: "found.")
    result = run("diagnose", "axis.parquet", "--model", MODEL, "--json", "a.json")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "found.\n", "")
    assert json.loads(Path("a.json").read_text("utf-8"), parse_constant=unlike_json) == expected


def test_reproduced_figures_decide_the_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    from fdbench.reproduce import Row

    def row(value: float) -> Row:
        return Row(paper="A", item="b", paper_value=None, value=value, target=1.0, tolerance=0.1, kind="must")

    for value, code, shown in ((1.0, 0, 1.0), (2.0, 1, 2.0), (float("nan"), 1, None)):
        monkeypatch.setattr("fdbench.reproduce.run", lambda paper, value=value: [row(value)])
        result = run("reproduce", "--json")
        assert (result.exit_code, result.stderr) == (code, "")
        assert json.loads(result.stdout)[0]["value"] == shown
        assert json.loads(result.stdout)[0]["ok"] is (code == 0)
        assert run("reproduce").exit_code == code


def test_a_figure_that_raises_is_a_failed_row_among_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures before it in its part, those of the other parts and those of the other papers stay."""
    from numpy.linalg import LinAlgError

    from fdbench.reproduce import Row, mcpherson, turkay

    def row(item: str) -> Row:
        return Row(paper="A", item=item, paper_value=None, value=1.0, target=1.0, tolerance=0.0, kind="ranking")

    def breaks() -> Iterator[Row]:
        yield row("before")
        raise LinAlgError("Singular [red] matrix")

    monkeypatch.setattr("fdbench.reproduce.papers", lambda: ["mcpherson", "turkay"])
    monkeypatch.setattr(mcpherson, "parts", lambda: {"broken": breaks, "whole": lambda: [row("after")]})
    monkeypatch.setattr(turkay, "parts", lambda: {"last": lambda: [row("other paper")]})
    result = run("reproduce", "--json")
    found = {item["item"]: item for item in json.loads(result.stdout)}
    failed = "broken: this and its further figures failed"
    assert (result.exit_code, result.stderr, list(found)) == (1, "", ["before", failed, "after", "other paper"])
    assert [item["ok"] for item in found.values()] == [True, False, True, True]
    contract = {"paper", "item", "paper_value", "value", "target", "tolerance", "kind", "ok"}
    assert all(contract <= set(item) for item in found.values())
    assert found[failed]["reason"] == "LinAlgError: Singular [red] matrix"
    assert (found[failed]["paper"], found[failed]["value"], found[failed]["kind"]) == (mcpherson.PAPER, None, "must")
    shown = run("reproduce")
    assert shown.exit_code == 1
    assert "4 figures, 1 outside" in shown.stdout
    assert "[red]" in shown.stdout


def test_an_interrupt_ends_the_reproduction(monkeypatch: pytest.MonkeyPatch) -> None:
    from fdbench.reproduce import run as run_reproduction
    from fdbench.reproduce import turkay

    def interrupted() -> Iterator[Any]:
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(turkay, "parts", lambda: {"first": interrupted})
    with pytest.raises(KeyboardInterrupt):
        run_reproduction("turkay")


def test_results_are_read_by_every_command(results: Path) -> None:
    assert {path.name for path in results.iterdir()} >= {"scores.parquet", "leaderboard.md", "report.html"}
    assert not Path("leaderboard.md").exists()
    assert run("leaderboard", results, "--check").exit_code == 1
    assert run("leaderboard", results).exit_code == 0
    assert Path("leaderboard.md").read_bytes() == (results / "leaderboard.md").read_bytes()
    assert run("leaderboard", results, "--check").exit_code == 0
    assert run("report", results, "-o", "bericht ü.html").exit_code == 0
    assert Path("bericht ü.html").stat().st_size > 10_000
    compared = run("compare", results, results, "--json")
    assert (compared.exit_code, compared.stderr) == (0, "")
    json.loads(compared.stdout)
    again = run(*RUN, "--estimator", "least_squares", "--out", results)
    assert "0 runs done, 3 kept from before (3 ok," in again.stdout
    assert f"Written: {results}/scores.parquet\n" in again.stdout


def test_only_what_has_changed_is_written_anew(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def files_written(*options: str) -> set[str]:
        done = run(*RUN, "--estimator", "least_squares", "--out", results, *options)
        assert done.exit_code == 0, done.output
        (line,) = re.findall("Written: (.*)", done.stdout)
        return {Path(name).name for name in line.split(", ")} - {"scores.parquet"}

    # What is on the page does not matter here, and takes a second each time.
    monkeypatch.setattr("fdbench.report.written.write_report", lambda folder, file: file.write_text("a page", "utf-8"))
    both = {"leaderboard.md", "report.html"}
    files_written()
    pages = {name: (results / name).read_bytes() for name in both}
    assert files_written() == set()
    (results / "report.html").unlink()
    assert files_written("--no-report") == set()
    assert files_written() == {"report.html"}
    (results / "leaderboard.md").write_text("edited", "utf-8")
    assert files_written() == {"leaderboard.md"}
    (results / "made_of.json").write_text("{", "utf-8")
    assert files_written() == both
    monkeypatch.setattr("fdbench.report.written._code", lambda: b"other code")
    assert files_written() == both
    shutil.rmtree(results / "runs" / "ShakerConstant-v1" / "least_squares")
    assert files_written("--no-report") == {"leaderboard.md"}
    assert files_written() == {"report.html"}
    assert (results / "leaderboard.md").read_bytes() == pages["leaderboard.md"]
    (estimate,) = (results / "estimates").rglob("least_squares/0.parquet")
    os.utime(estimate, (0, 0))
    assert files_written() == both


def test_a_page_that_was_made_while_another_run_wrote_is_made_again(tmp_path: Path) -> None:
    for name in ("scores.parquet", "parameters.parquet"):
        write(name, "before")
    maker = {"page": lambda file: (file.write_text("made", "utf-8"), write("scores.parquet", "after"))}
    assert [write_changed(tmp_path, maker) for _ in range(3)] == [["page"], ["page"], []]


def test_a_run_leaves_the_leaderboard_beside_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fdbench.catalogue.scenario_ids", lambda: ["ShakerConstant-v0"])
    monkeypatch.setattr(estimators, "names", lambda: ["null"])
    write("leaderboard.md", "tracked")
    assert run("run", "--jobs", "1", "--no-report").exit_code == 0
    assert Path("results/leaderboard.md").is_file()
    assert not Path("results/report.html").exists()
    assert Path("leaderboard.md").read_text("utf-8") == "tracked"


def test_a_run_without_a_good_one_fails(tmp_path: Path) -> None:
    bad = write("bad.py", ESTIMATOR.replace("        target = ", "        raise ValueError('no')\n        target = "))
    arguments = [*RUN, "--no-report", "--out", "out", "--estimator"]
    failed = run(*arguments, bad)
    assert (failed.exit_code, failed.stderr) == (1, "")
    assert failed.stdout.endswith("No run went well, null and oracle apart: 1 failed.\n")
    assert run(*arguments, bad, "--estimator", "least_squares").exit_code == 0
    assert run(*arguments, "null").exit_code == 0


def test_skips_are_counted_once() -> None:
    picky = write("picky.py", ESTIMATOR + "\n    def skip(self, context):\n        return 'never'\n")
    for _ in range(2):
        done = run(*RUN, "--no-report", "--estimator", picky, "--estimator", "least_squares", "--out", "out")
        assert done.stdout.count("skipped") == 2
        assert "1 skipped). Why runs were skipped: out/leaderboard.md.\n" in done.stdout


def test_other_results_of_the_folder_are_kept_and_shown(results: Path) -> None:
    text = (results / "leaderboard.md").read_text("utf-8")
    done = run(*RUN, "--estimator", write("mean_force.py", ESTIMATOR), "--out", results)
    assert (done.exit_code, done.stderr) == (0, "")
    assert "The files hold 1 other run of this folder too." in done.stdout
    assert "Left out" not in done.stdout
    assert "mean_force" in done.stdout
    assert "least_squares" not in done.stdout  # not asked for this time
    for name in ("leaderboard.md", "report.html"):
        assert {"least_squares", "mean_force"} <= set(re.findall(r"\w+", (results / name).read_text("utf-8")))
    write("mean_force.py", ESTIMATOR + "\n# another one\n")
    again = run(
        *RUN, "--no-report", "--estimator", "mean_force.py", "--seeds", "2", "--first-seed", "1", "--out", results
    )
    assert "Left out: 1 earlier run of mean_force on ShakerConstant-v1, as their scenario" in again.stdout
    shutil.rmtree(results / "runs" / "ShakerConstant-v1" / "mean_force")
    for file in (results / "runs").rglob("[12].json"):
        file.unlink()
    assert run(*RUN, "--estimator", "least_squares", "--out", results).exit_code == 0
    assert (results / "leaderboard.md").read_text("utf-8") == text


def test_the_page_of_a_diagnosis_is_made_from_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Path, Path]] = []
    monkeypatch.setattr("fdbench.report.answer.write_answer", lambda source, output: seen.append((source, output)))
    assert run("report", write("a.json", "{}"), "-o", "b.html").exit_code == 0
    assert seen == [(Path("a.json"), Path("b.html"))]


def test_damaged_results_are_refused(results: Path) -> None:
    Path("damaged").mkdir()
    for content in (b"", b"no table", (results / "scores.parquet").read_bytes()[:-100]):
        Path("damaged/scores.parquet").write_bytes(content)
        for command in (["leaderboard", "damaged"], ["report", "damaged"], ["compare", "damaged", results]):
            assert "damaged/scores.parquet: cannot be read" in refused(*command)
    scores = pd.read_parquet(results / "scores.parquet")
    for table, message in (
        (scores.iloc[:0], "no rows"),
        (scores.assign(status="odd"), "unknown status"),
        (scores.assign(value="x"), "column value holds other values than float64"),
        (scores.assign(seed=0.5), "column seed holds other values than int64"),
        (scores.assign(scenario=None), "column scenario holds other values than string"),
        (scores.assign(value=float("inf")), "column value holds values beyond 1e+100"),
        (scores.drop(columns="unit"), r"column unit is missing"),
    ):
        table.to_parquet("damaged/scores.parquet")
        for command in (["leaderboard", "damaged"], ["report", "damaged"], ["compare", "damaged", results]):
            assert f"damaged{os.sep}scores.parquet: " in refused(*command)
            assert message in refused(*command)
    neighbour = results.parent / "Ergebnis"
    assert f"Did you mean {results.name}?" in refused("report", neighbour)


# ---- processes ----


def test_listing_is_quick() -> None:
    program = "import sys\nfrom fdbench.cli import main\nsys.argv = ['fdbench', 'list', sys.argv[1]]\n"
    program += "try:\n    main()\nexcept SystemExit:\n    print(*sys.modules, file=sys.stderr)\n"
    for kind in ("effects", "scenarios"):
        words = [sys.executable, "-c", program, kind]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        slow = {"numba", "pandas", "scipy", "pyarrow", "plotly", "control", "fdbench.effects", "fdbench.scenario"}
        assert slow & set(done.stderr.split()) == set()
        assert len(done.stdout.splitlines()) > 20


def test_a_closed_pipe_and_a_full_disk_leave_no_traceback() -> None:
    with start("list", "effects") as listing:
        assert listing.stdout is not None
        assert listing.stderr is not None
        listing.stdout.close()
        assert listing.stderr.read() == ""
    full = Path("/dev/full")
    if full.exists():
        with full.open("w") as nowhere, start("list", "effects", stdout=nowhere) as listing:
            assert listing.communicate()[1] == "fdbench: No space left on device.\n"
        assert listing.returncode == 2


SLOW = ESTIMATOR.replace("import numpy as np", "import time\nfrom pathlib import Path\n\nimport numpy as np").replace(
    "        target = ",
    "        time.sleep(0.1)\n"
    "        while Path('wait').exists() and Path('out/runs/ShakerConstant-v0/slow_mean/0.json').exists():\n"
    "            time.sleep(0.01)\n"
    "        target = ",
)
# A process in the background is started deaf to the interrupt, and so is what it starts.
HEARS = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "


def lines_of(process: "subprocess.Popen[str]") -> Iterator[str]:
    assert process.stdout is not None
    yield from process.stdout


def test_an_interrupted_run_resumes() -> None:
    slow = write("slow_mean.py", SLOW)
    arguments = [*RUN[:3], "--seeds", "4", "--jobs", "1", "--no-report", "--out", "out", "--estimator", slow]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    environment.pop("COLUMNS", None)
    Path("wait").touch()
    program = [sys.executable, "-c", f"{HEARS}from fdbench.cli import main; main()"]
    with start(*arguments, program=program, env=environment) as process:
        assert next(lines_of(process)) == "1/4 ShakerConstant-v1 seed 0\n"
        process.send_signal(signal.SIGINT)
        assert process.communicate()[1] == "fdbench: interrupted; what is finished is kept.\n"
    assert process.returncode == 130
    assert not Path("out/scores.parquet").exists()
    assert not list(Path("out").rglob("*.partial"))
    finished = len(list(Path("out/runs").rglob("*.json")))
    assert 3 <= finished < 12
    Path("wait").unlink()
    with start(*arguments, env=environment) as process:
        beside = run(*arguments[:-2], "--estimator", "null")
        out, err = process.communicate()
    assert (process.returncode, err, beside.exit_code, beside.stderr) == (0, "", 0, "")
    counts = re.search(r"(\d+) runs done, (\d+) kept from before \(12 ok", out)
    assert counts is not None
    assert int(counts[2]) >= finished
    assert "slow_mean" in out
    assert "\x1b" not in out
