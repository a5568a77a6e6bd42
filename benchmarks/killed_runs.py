"""Kill runs at random instants, start each again until it ends, and compare it with one that was not killed.

`python benchmarks/killed_runs.py --kills 1000` prints how many kills there were and each defect once: other results
than without a kill, a command that ends with an error, processes that outlive their parent by more than `PATIENCE_S`.
Exits with 1 where there is one. A kill within a write leaves an unfinished file beside its place, which a run removes
an hour later; these are counted. Needs Linux.

One start in twenty is the command line. The others are forks of this process, which has imported fdbench and loaded its
compiled code: they call what the command line calls, with its arguments, in a session of their own. Of such a start
four things differ from the command: nothing is imported, so that no kill falls into imports; the fork server of the
estimators is forked before the command begins, and waits, in place of an interpreter that the command starts; one
process simulates (`--jobs 1`), not one for each core; and of what Python does at its end only that server is closed.
"""

import argparse
import ctypes
import gc
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from io import StringIO
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn
from unittest.mock import patch

import pandas as pd
from pandas.testing import assert_frame_equal

from fdbench import cli
from fdbench.benchmark import job
from fdbench.files import UNFINISHED
from fdbench.sandbox import launch, server

PATIENCE_S = 10.0
LONGEST_S = 600.0  # after which a command that has not ended hangs
COMMAND_LINE_SHARE = 0.05
CHILD_SUBREAPER = 36
LONGEST_TERMS, LONGEST_TEXT = 1 << 20, 500
SCENARIOS = ("SlotMilling-v2", "SlotMillingRunout200Rpm25N-v2")  # the shortest with parameters, records and estimates
ESTIMATORS = ("least_squares", "null")
SEEDS = 2
ARGUMENTS = [
    "run",
    *(word for name in SCENARIOS for word in ("--scenario", name)),
    *(word for name in ESTIMATORS for word in ("--estimator", name)),
    *("--seeds", str(SEEDS), "--no-report", "--out"),
]
# What is measured of the machine, and what tells one run from another.
VARYING_COLUMNS = ["seconds", "peak_memory_MB", "run_id", "utc"]
VARYING_METRIC = "microseconds_per_sample"


# ---- starts ----


class WaitingServer:
    """Stands for `subprocess.Popen` where a run starts its fork server: one that was forked before, and waits."""

    def __init__(self) -> None:
        self._asked, theirs = socket.socketpair()
        self.pid = os.fork()
        if self.pid == 0:
            self._asked.close()
            serve(theirs)
        theirs.close()

    def __call__(
        self, command: Sequence[str], *, env: Mapping[str, str], pass_fds: Sequence[int], **_: Any
    ) -> "WaitingServer":
        """Have it serve, with what a new interpreter would be given."""
        socket.send_fds(self._asked, [json.dumps([command[-1], env]).encode()], list(pass_fds))
        return self

    def poll(self) -> int | None:
        """Return how it ended, or None where it has not."""
        try:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
        except ChildProcessError:
            return 0
        return os.waitstatus_to_exitcode(status) if ended else None

    def wait(self, timeout: float) -> int:
        """Wait for its end."""
        end = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("fork server", timeout)
            time.sleep(1e-3)
        return code

    def kill(self) -> None:
        """End it."""
        os.kill(self.pid, signal.SIGKILL)


def serve(asked: socket.socket) -> NoReturn:
    """Wait until the run asks for a server, and be it; leave when the run is gone."""
    try:
        os.setsid()
        terms, descriptors, _, _ = socket.recv_fds(asked, LONGEST_TERMS, 1)
        if terms:
            path, environment = json.loads(terms)
            sys.path[:] = json.loads(path)
            os.environ.clear()
            os.environ.update(environment)
            os.chdir("/")
            server.main(descriptors[0])
    finally:
        os._exit(0)


def by_fork(folder: Path) -> int:
    """Start the run in a fork of this process, and return its process."""
    pid = os.fork()
    if pid:
        return pid
    code: Any = 1
    try:
        os.setsid()
        redirect(os.open(os.devnull, os.O_RDONLY), 0)
        redirect(os.open(folder / "output.txt", os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600), 1, 2)
        sys.argv[:] = arguments(folder)
        subprocesses = SimpleNamespace(
            Popen=WaitingServer(), DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired
        )
        with patch.object(launch, "subprocess", subprocesses):
            try:
                cli.main()
            except SystemExit as end:
                code = end.code or 0
            if launch._server is not None:
                launch._server.close()
    except BaseException:  # noqa: BLE001  (a fork must not return to where it began)
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else 1)


def arguments(folder: Path) -> list[str]:
    """Return the command line of a fork; processes of joblib would be new interpreters."""
    return ["fdbench", *ARGUMENTS, str(folder / "results"), "--jobs", "1"]


def redirect(descriptor: int, *targets: int) -> None:
    for target in targets:
        os.dup2(descriptor, target)
    os.close(descriptor)


def by_command_line(folder: Path) -> int:
    """Start the run as a user does, and return its process."""
    command = [str(Path(sys.executable).with_name("fdbench")), *ARGUMENTS, str(folder / "results")]
    output = str(folder / "output.txt")
    actions = [
        (os.POSIX_SPAWN_OPEN, 1, output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600),
        (os.POSIX_SPAWN_DUP2, 1, 2),
    ]
    return os.posix_spawn(command[0], command, os.environ, file_actions=actions)


def warm_up() -> None:
    """Do the run once in this process, so that forks need not import anything or load compiled code."""
    server._warm_up()
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(sys, "argv", arguments(Path(folder))),
        redirect_stdout(StringIO()),
        suppress(SystemExit),
    ):
        cli.main()
    if job._kept.sandbox is not None and launch._server is not None:
        job._kept.sandbox.close()
        launch._server.close()
    job._kept.sandbox = launch._server = None
    gc.freeze()  # a collection in a fork would copy all that it looks at


# ---- ends ----


def ended(pid: int, within_s: float) -> int | None:
    """Return the exit code of a process that ends within a time, or None."""
    end = time.monotonic() + within_s
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            return None
        time.sleep(min(2e-3, max(end - time.monotonic(), 0.0)))


def left_alive() -> list[str]:
    """Return the commands of the processes that there are, beside this one, after `PATIENCE_S`, and end them."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass
        except ChildProcessError:
            return []
        if time.monotonic() > end:
            break
        time.sleep(5e-3)
    left = [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]
    commands = [Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode() for pid in left]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    return commands


def tables(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame, list[str]]:
    """Return scores and parameters without what varies from run to run, in one order, and names of finished files."""
    results = folder / "results"
    scores, parameters = (pd.read_parquet(results / f"{name}.parquet") for name in ("scores", "parameters"))
    scores.loc[scores.metric == VARYING_METRIC, "value"] = 0.0
    found = [
        table.drop(columns=VARYING_COLUMNS, errors="ignore").sort_values(keys, ignore_index=True)
        for table, keys in (
            (scores, ["scenario", "estimator", "seed", "metric"]),
            (parameters, ["scenario", "estimator", "seed", "parameter"]),
        )
    ]
    files = sorted(
        str(path.relative_to(results))
        for path in results.rglob("*")
        if path.is_file() and not path.name.endswith(UNFINISHED)
    )
    return found[0], found[1], files


def difference(folder: Path, reference: Path) -> str:
    """Return what the results of a folder have otherwise, or nothing."""
    expected = tables(reference)
    try:
        found = tables(folder)
        for table, wanted in zip(found[:2], expected[:2], strict=True):
            assert_frame_equal(table, wanted, check_exact=True)
    except (AssertionError, OSError, ValueError, KeyError) as error:
        return f"other results: {str(error)[:LONGEST_TEXT]}"
    other = sorted({*found[2]} ^ {*expected[2]})
    return f"files in only one of both: {other}" if other else ""


# ---- the attack ----


class Attack:
    """Kills so far, and what they found."""

    def __init__(self, place: Path, seed: int) -> None:
        self.place, self.random = place, random.Random(seed)
        self.kills, self.runs, self.starts, self.by_command_line, self.unfinished = 0, 0, 0, 0, 0
        self.defects = Counter[str]()
        self.lasts_s: dict[Callable[[Path], int], float] = {}

    def measure(self) -> Path:
        """Run to the end without a kill, in each way, and return the folder of the last."""
        for number, start in enumerate((by_command_line, by_fork, by_command_line, by_fork)):
            folder = self.folder(f"reference {number}")
            begin = time.monotonic()
            if (code := ended(start(folder), LONGEST_S)) != 0:
                raise SystemExit(f"exit {code}: {(folder / 'output.txt').read_text()}")
            self.lasts_s[start] = min(time.monotonic() - begin, self.lasts_s.get(start, LONGEST_S))
            if found := difference(folder, self.place / "reference 0"):
                raise SystemExit(f"{start.__name__}, without a kill: {found}")
        return folder

    def note(self, defect: str) -> None:
        """Count a defect, and print it."""
        self.defects[defect] += 1
        print(f"DEFECT {defect}", flush=True)

    def folder(self, name: str) -> Path:
        folder = self.place / name
        folder.mkdir()
        return folder

    def until_it_ends(self, folder: Path) -> None:
        """Start a run, kill it at an instant of the time that a whole one takes, and again until one has ended.

        Instants are drawn from a tenth more after each kill, so that it ends on a machine that is busy by now too.
        """
        for before in count():
            is_command_line = self.random.random() < COMMAND_LINE_SHARE
            start = by_command_line if is_command_line else by_fork
            pid = start(folder)
            self.starts, self.by_command_line = self.starts + 1, self.by_command_line + is_command_line
            code = ended(pid, self.random.uniform(0.0, (1.0 + 0.1 * before) * self.lasts_s[start]))
            if code is not None:
                if code:
                    self.note(f"exit {code}: {(folder / 'output.txt').read_text()[-LONGEST_TEXT:]}")
                return
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            self.kills += 1
            if commands := left_alive():
                self.note(f"outlive a killed run ({start.__name__}) by {PATIENCE_S:g} s: {'; '.join(commands)}")


def main() -> int:
    """Kill until there were as many kills as asked for, print what was found, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warm_up()
    ctypes.CDLL(None, use_errno=True).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)  # what is left by a killed run comes here
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        attack = Attack(Path(place), given.seed)
        reference = attack.measure()
        for start, lasts_s in attack.lasts_s.items():
            print(f"{start.__name__}: a run of {lasts_s:.1f} s", flush=True)
        while attack.kills < given.kills:
            folder = attack.folder(str(attack.runs))
            attack.until_it_ends(folder)
            attack.unfinished += len(list(folder.rglob(f"*{UNFINISHED}")))
            if found := difference(folder, reference):
                attack.note(f"run {attack.runs}: {found}")
            attack.runs += 1
            print(
                f"{attack.kills} kills, {attack.runs} runs, {attack.starts} starts ({attack.by_command_line} by the "
                f"command line), {attack.unfinished} unfinished files left, {attack.defects.total()} defects, "
                f"{time.monotonic() - begin:.0f} s",
                flush=True,
            )
    for defect, times in attack.defects.items():
        print(f"{times} x {defect}")
    return 1 if attack.defects else 0


if __name__ == "__main__":
    sys.exit(main())
