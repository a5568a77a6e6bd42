"""Estimators that fail, crash, hang or answer nonsense are rows, with the place in their file; the run goes on."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from short_scenario import short_scenario
from typer.testing import CliRunner

from fdbench import registry
from fdbench.benchmark.run import run
from fdbench.benchmark.statistics import run_statuses
from fdbench.benchmark.store import RunKey, Store
from fdbench.cli import app
from fdbench.errors import FdbenchError
from fdbench.estimator import estimators
from fdbench.sandbox import seccomp

pytestmark = pytest.mark.usefixtures("own_plugin_files")

FILES = sorted((Path(__file__).parent / "misbehaving").glob("*.py"))
MEMORY_MB = 1024.0

# Only those that never end are held to a time, so that the others may take theirs on a busy machine.
ENDLESS, TIME_S = ("never_ends", "never_ends_deaf", "sleeps"), 2.0

# Where `fit` begins, of those that leave no call behind in which they failed.
AT_FIT = {
    "closes_everything": 11,
    "exits_in_compiled_code": 11,
    "kills_itself_in_compiled_code": 12,
    "never_ends_deaf": 11,
    "returns_a_million_names": 9,
    "returns_complex": 11,
    "returns_gigabytes": 11,
    "returns_nan": 11,
    "returns_objects": 11,
    "returns_unprintable_names": 9,
    "returns_wrong_length": 11,
    "returns_wrong_names": 9,
    "writes_garbage": 12,
    "writes_half_an_answer": 14,
}

MESSAGES = {
    "aborts": "aborts.py:12: crashed with SIGABRT",
    "closes_everything": "ended its process with status 1, without an answer",
    "closes_its_outputs": "closes_its_outputs.py:17: ValueError: after closing",
    "crashes": "crashes.py:12: crashed with SIGSEGV",
    "exits_in_compiled_code": "ended its process with status 0, without an answer",
    "exits_with_0": "exits_with_0.py:12: an estimator may not end its process (os._exit(0))",
    "exits_with_1": "exits_with_1.py:12: an estimator may not end its process (os._exit(1))",
    "kills_itself": "kills_itself.py:13: an estimator may not send a signal (os.kill)",
    "kills_itself_in_compiled_code": "crashed with SIGKILL, by itself or for want of memory",
    "leaves_a_process": "leaves_a_process.py:16: ValueError: forked",
    "leaves_generations": "leaves_generations.py:24: ValueError: forked",
    "limits_others": f"limits_others.py:34: ValueError: {'refused' if seccomp.is_available() else ''}",
    "never_ends": "never_ends.py:1",  # line 10 or 11, as it was met
    "never_ends_deaf": "took longer than 2 s",
    "predicts_nothing_useful": "",
    "raises_generator_exit": "raises_generator_exit.py:10: GeneratorExit",
    "raises_its_own": "raises_its_own.py:14: _Own: own",
    "raises_key_error": "raises_key_error.py:10: KeyError: 'missing'",
    "raises_keyboard_interrupt": "raises_keyboard_interrupt.py:10: KeyboardInterrupt",
    "raises_megabytes": "raises_megabytes.py:10: ValueError: xxxxxxx",
    "raises_without_text": "raises_without_text.py:17: _Silent: its text cannot be made",
    "recurses": "recurses.py:10: RecursionError: maximum recursion depth exceeded",
    "returns_a_million_names": "PluginError: parameters has 1000000 names; at most 1000 are allowed.",
    "returns_complex": "PluginError: output is a ndarray of type complex128, expected real numbers.",
    "returns_gigabytes": "needed more than 1024 MB of memory",
    "returns_nan": "PluginError: parameters['beta_1'] is nan, expected a finite number up to 1e+100.",
    "returns_objects": "PluginError: output is a ndarray of type object, expected real numbers.",
    "returns_poison": "returns_poison.py:11: RuntimeError: poisoned",
    "returns_unprintable_names": "its answer cannot be used: the names of its parameters are too long or cannot be",
    "returns_wrong_length": "PluginError: output has shape (3,), expected (998,), one value for each row",
    "returns_wrong_names": "PluginError: parameters['beta1']: the model has no such parameter. Did you mean beta_1?",
    "skips_with_a_crash": "skips_with_a_crash.py:15: crashed with SIGSEGV",
    "sleeps": "sleeps.py:13: took longer than 2 s",
    "sys_exits": "sys_exits.py:12: SystemExit: 0",
    "takes_memory": "takes_memory.py:12: needed more than 1024 MB of memory (Unable to allocate 14.9 GiB",
    "takes_memory_bit_by_bit": "takes_memory_bit_by_bit.py:12: needed more than 1024 MB of memory",
    "writes_garbage": "its answer cannot be used: it is none to what was asked",
    "writes_half_an_answer": "its answer cannot be used: it is none to what was asked",
}


MADE_FOR_A_TEXT = """
from fdbench.estimator import BatchEstimator, Estimate
class Faulty(BatchEstimator):
    made_for = 'velocity_loop'
    def fit(self, context, record):
        return Estimate()
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    folder = tmp_path_factory.mktemp("misbehaving")
    scenario = short_scenario(folder, "Short-v0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_files", {})
        for time_limit_s, is_endless in ((300.0, False), (TIME_S, True)):
            files = [str(file) for file in FILES if (file.stem in ENDLESS) == is_endless]
            run([scenario], files, 1, folder / "out", time_limit_s=time_limit_s, memory_limit_MB=MEMORY_MB)
    return Store(folder / "out")


@pytest.mark.parametrize("name", [file.stem for file in FILES])
def test_whatever_an_estimator_does_is_one_row(name: str, store: Store) -> None:
    found = store.read_run(RunKey("Short-v0", name, 0))
    assert found is not None
    place = f"{name}.py:{AT_FIT[name]}: " if name in AT_FIT else ""
    assert found.message.startswith(place + MESSAGES[name])
    assert name != "never_ends" or found.message.endswith("took longer than 2 s")
    assert found.status == ("failed" if MESSAGES[name] else "ok")
    assert len(found.message) < 1000
    assert len(found.traceback) < 50_000
    if ".py:" in MESSAGES[name]:
        assert f'{name}.py", line ' in found.traceback


def test_those_that_behave_are_not_harmed(store: Store) -> None:
    for name in ("null", "oracle"):
        found = store.read_run(RunKey("Short-v0", name, 0))
        assert found is not None
        assert found.status == "ok"


def test_limits_out_of_bounds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FdbenchError, match=r"time limit in s 0\.0: at least 0\.1"):
        run(["ShakerConstant-v0"], [], 1, tmp_path, time_limit_s=0.0)
    with pytest.raises(FdbenchError, match=r"memory limit in MB 1\.0: at least 512"):
        run(["ShakerConstant-v0"], [], 1, tmp_path, memory_limit_MB=1.0)


# ---- while they are imported ----

AT_IMPORT = {
    "ends": ("import os\nos._exit(0)\n", "cannot be imported: line 2: Refused: an estimator may not end its process"),
    "exits": ("import sys\n\nsys.exit(0)\n", "cannot be imported: line 3: SystemExit: 0"),
    "breaks": ("x = 1\ndef f(:\n", "cannot be imported: line 2: SyntaxError: invalid syntax"),
    "lacks": ("import nothing_of_this_name\n", "cannot be imported: line 1: ModuleNotFoundError: No module named"),
    "raises": ("x = 1\n\nx / 0\n", "cannot be imported: line 3: ZeroDivisionError: division by zero"),
    "crashes_at_once": ("import ctypes\nctypes.string_at(0)\n", "2: crashed with SIGSEGV"),
    "reads": (
        "from fdbench.scenario import load_scenario\n",
        "cannot be imported: line 1: Refused: an estimator may not",
    ),
    "interrupts": ("raise KeyboardInterrupt\n", "1: KeyboardInterrupt"),
    "adds": (f"x = 1{'+1' * 100_000}\n", "cannot be imported: RecursionError"),
    "nests": (f"x = {'-' * 200_000}1\n", "cannot be imported: MemoryError"),
    "is_made_for_a_text": (MADE_FOR_A_TEXT, "made_for is 'velocity_loop', expected names such as ('velocity_loop',)"),
    "is_empty": ("x = 1\n", "a plug-in file defines exactly one Estimator, found no class derived from it."),
    "hangs": ("x = 1\nwhile True: x += 1\n", "2: took longer than 2 s"),
}


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Return the results of files that are at fault while they are imported, beside one that fits."""
    folder = tmp_path_factory.mktemp("imported")
    files = [folder / f"{name}.py" for name in AT_IMPORT]
    for file, (text, _) in zip(files, AT_IMPORT.values(), strict=True):
        file.write_text(text, "utf-8")
    scenario = short_scenario(folder, "Short-v0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_files", {})
        for is_endless in (False, True):
            chosen = [str(file) for file in files if (file.stem == "hangs") == is_endless]
            names = chosen if is_endless else [*chosen, f"{folder / 'lacks.py'}[a=1]", "least_squares"]
            run([scenario], names, 1, folder / "out", time_limit_s=TIME_S if is_endless else 300.0)
    return Store(folder / "out")


@pytest.mark.parametrize("name", AT_IMPORT)
def test_a_file_that_cannot_be_imported_is_a_row(name: str, imported: Store) -> None:
    found = imported.read_run(RunKey("Short-v0", name, 0))
    assert found is not None
    message = AT_IMPORT[name][1]
    assert found.message.startswith(f"{name}.py:{'' if message[0].isdigit() else ' '}{message}")
    assert found.status == "failed"
    assert {score.status for score in found.scores} == {"failed"}
    executed = name not in ("breaks", "adds", "nests", "is_made_for_a_text", "is_empty")
    assert (f'{name}.py", line ' in found.traceback) == executed


def test_those_that_can_be_imported_are_run_as_ever(imported: Store) -> None:
    statuses = run_statuses(imported.scores()).set_index("estimator")["status"]
    assert sorted(statuses[statuses == "ok"].index) == ["least_squares", "null", "oracle"]
    assert sorted(statuses[statuses == "failed"].index) == sorted([*AT_IMPORT, "lacks[a=1]"])


def test_the_command_goes_on_over_a_file_that_cannot_be_imported(tmp_path: Path) -> None:
    file, scenario = tmp_path / "faulty.py", short_scenario(tmp_path, "Short-v0")
    file.write_text("x = 1\n\nx / 0\n", "utf-8")
    options = ["--scenario", scenario, "--jobs", "1", "--no-report", "--traceback", "--out", str(tmp_path / "out")]
    alone = CliRunner().invoke(app, ["run", "--estimator", str(file), *options])
    assert alone.exit_code == 1
    assert "No run went well, null and oracle apart: 3 failed." in alone.stdout
    assert re.search(r"faulty on Short-v0, seed 0:\n.*faulty\.py\", line 3, in <module>\n", alone.stderr, re.DOTALL)
    for wrong in (str(tmp_path / "fauly.py"), f"{file}[a]", "least_square"):
        refused = CliRunner().invoke(app, ["run", "--estimator", wrong, *options])
        assert (refused.exit_code, refused.stdout) == (2, "")


def test_an_installed_package_that_cannot_be_imported_is_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    inner = tmp_path / "faulty_package" / "inner"
    inner.mkdir(parents=True)
    (inner.parent / "__init__.py").write_text("print('executed')\nraise ValueError('at import')\n", "utf-8")
    for name in ("__init__", "one_of_it"):
        (inner / f"{name}.py").write_text("", "utf-8")
    information = tmp_path / "faulty-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 1.0\n", "utf-8")
    (information / "entry_points.txt").write_text("[fdbench.estimators]\nfaulty = faulty_package.inner\n", "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._packages.cache_clear()
    try:
        assert "one_of_it" in estimators.names()
        assert "executed" not in "".join(capfd.readouterr())
        run([short_scenario(tmp_path, "Short-v0")], ["one_of_it"], 1, tmp_path / "out")
    finally:
        monkeypatch.undo()
        registry._packages.cache_clear()
    found = Store(tmp_path / "out").read_run(RunKey("Short-v0", "one_of_it", 0))
    assert found is not None
    place = "estimator 'one_of_it' (faulty_package.inner.one_of_it) cannot be imported: "
    assert (found.status, found.message) == ("failed", f"{place}ValueError: at import")
    assert 'faulty_package/__init__.py", line 2' in found.traceback


# ---- processes ----


def descendants(pid: int) -> set[int]:
    found = set()
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, children.read_text("ascii").split()):
            found |= {child} | descendants(child)
    return found


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def started(tmp_path: Path, jobs: int) -> tuple["subprocess.Popen[bytes]", set[int]]:
    """Return a run that hangs in an estimator, and its processes."""
    file = tmp_path / "hangs.py"
    text = (Path(__file__).parent / "misbehaving" / "never_ends.py").read_text("utf-8")
    file.write_text(text.replace("while True", "print('fitting', flush=True)\n        while True"), "utf-8")
    scenario = short_scenario(tmp_path, "Short-v0")
    arguments = ["run", "--scenario", scenario, "--estimator", str(file), "--seeds", "1", "--jobs", str(jobs)]
    main = subprocess.Popen(
        [sys.executable, "-m", "fdbench", *arguments, "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        # A suite that runs in the background of a shell ignores interrupts, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert main.stdout is not None
    while b"fitting" not in main.stdout.readline():
        assert main.poll() is None
    return main, descendants(main.pid)


def gone(pids: set[int]) -> bool:
    deadline = time.monotonic() + 120.0
    while any(map(is_running, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(is_running, pids))


# Which refuses them to begin with.
WITHOUT_SECCOMP = """
import sys
from fdbench import registry
from fdbench.benchmark.run import run
from fdbench.sandbox import seccomp
seccomp.is_available = lambda: False
run([sys.argv[1]], [sys.argv[2]], 1, sys.argv[3])
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
def test_no_process_outlives_its_worker(tmp_path: Path) -> None:
    file = Path(__file__).parent / "misbehaving" / "leaves_generations.py"
    scenario = short_scenario(tmp_path, "Short-v0")
    arguments = [sys.executable, "-c", WITHOUT_SECCOMP, scenario, str(file), str(tmp_path / "out")]
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert "left behind" not in {comm.read_text("utf-8").strip() for comm in Path("/proc").glob("[0-9]*/comm")}


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
@pytest.mark.parametrize("jobs", [1, 2])
def test_no_process_outlives_a_main_process_that_was_killed(tmp_path: Path, jobs: int) -> None:
    main, others = started(tmp_path, jobs)
    with main:
        assert len(others) >= 2
        if jobs > 1:  # joblib's own look after themselves, but not when they are stopped so hard
            others = {pid for pid in others if b"fdbench.sandbox" in Path(f"/proc/{pid}/cmdline").read_bytes()}
            for pid in descendants(main.pid) - others:
                os.kill(pid, signal.SIGKILL)
        main.kill()
        assert gone(others)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
def test_ctrl_c_interrupts_a_run_that_hangs_in_an_estimator(tmp_path: Path) -> None:
    main, others = started(tmp_path, 1)
    with main:
        main.send_signal(signal.SIGINT)
        assert main.wait(120.0) == 130
        assert gone(others)
