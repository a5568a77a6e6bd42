"""The fork server: it imports once what estimators need, and forks a worker for each of them.

It runs no plug-in. It ends, with all its workers, when the process that started it does.

===========  ================================  ==================================================
request      comes with                        answer
===========  ================================  ==================================================
``fork``     the worker's end of a channel,    ``pid``
             and a file for its last words
``end``      ``pid``, ``wait_s``               ``status`` as of wait(2), or null if it had to be killed
===========  ================================  ==================================================
"""

import ctypes
import faulthandler
import json
import os
import shutil
import signal
import socket
import sys
import tempfile
import time
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from fdbench.estimator import estimators
from fdbench.plants._controllers import OpenLoop
from fdbench.plants._drive_parts import LinearMotor
from fdbench.plants.feed_drive import FeedDrive
from fdbench.plants.servo_stage import ServoStage
from fdbench.record import Record
from fdbench.sandbox.confine import Reach, common_reach
from fdbench.sandbox.worker import PluginServer, leave

LONGEST_REQUEST = 4096

MOST_GENERATIONS = 1000

PARENT_DEATH_SIGNAL, CHILD_SUBREAPER = 1, 36


def main(descriptor: int) -> None:
    """Serve until the other side is gone."""
    del sys.argv[1:], sys.orig_argv[1:]
    control = socket.socket(fileno=descriptor)
    control.set_inheritable(False)
    # Orphans of a worker come here, so that they can be ended with it.
    _prctl(CHILD_SUBREAPER, 1)
    reach = common_reach(sys.path)
    _warm_up()
    folder = Path(tempfile.mkdtemp(prefix="fdbench-"))
    workers: set[int] = set()
    control.sendall(b"{}\n")
    try:
        while True:
            content, descriptors, _, _ = socket.recv_fds(control, LONGEST_REQUEST, 2)
            if not content:
                break
            answer = _answer(json.loads(content), descriptors, control, reach, folder, workers)
            control.sendall(json.dumps(answer).encode() + b"\n")
    finally:
        for pid in list(workers):
            _end(pid, workers, 0.0)
        shutil.rmtree(folder, ignore_errors=True)
    leave(0)  # Python would take half a second to take down what was imported


def _warm_up() -> None:
    """Load what most estimators import, and the machine code of the nominal machines that they simulate."""
    import scipy.linalg
    import scipy.optimize
    import scipy.signal  # noqa: F401

    estimators.names()
    time_s, at_rest = 1e-3 * np.arange(3.0), np.zeros(3)
    command = Record({"time_s": time_s, "reference_position_m": at_rest, "reference_velocity_m_per_s": at_rest})
    drive = FeedDrive(
        motor=LinearMotor(mass_kg=1.0, viscous_friction_N_s_per_m=1.0),
        controller=OpenLoop(acceleration_feedforward_kg=1.0, force_limit_N=1.0),
        travel_m=1.0,
        velocity_limit_m_per_s=1.0,
    )
    drive.respond(command)
    stage = ServoStage(
        mass_kg=1.0, damping_N_s_per_m=1.0, stiffness_N_per_m=1.0, travel_m=1.0, velocity_limit_m_per_s=1.0
    )
    stage.nominal_response(command)


def _answer(
    request: dict[str, Any],
    descriptors: list[int],
    control: socket.socket,
    reach: Reach,
    folder: Path,
    workers: set[int],
) -> dict[str, Any]:
    if request["do"] == "end":
        status = _end(request["pid"], workers, request["wait_s"])
        shutil.rmtree(folder / str(request["pid"]), ignore_errors=True)
        return {"status": status}
    channel, file = descriptors
    pid = os.fork()
    if pid == 0:
        control.close()
        _become_worker(socket.socket(fileno=channel), file, reach, folder)
    os.close(channel)
    os.close(file)
    workers.add(pid)
    return {"pid": pid}


def _become_worker(channel: socket.socket, last_words: int, reach: Reach, folder: Path) -> NoReturn:
    """Live on as a worker."""
    try:
        os.setsid()
        server = os.getppid()
        _prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != server:
            leave(1)
        faulthandler.enable(last_words)
        own = folder / str(os.getpid())
        own.mkdir()
        os.chdir(own)
        os.environ["HOME"] = os.environ["TMPDIR"] = tempfile.tempdir = str(own)
        # What a plug-in prints is no result, and must not be lost with its process.
        os.dup2(2, 1)
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(line_buffering=True)
        PluginServer(channel, reach, own).serve()
    finally:
        leave(1)


def _end(pid: int, workers: set[int], wait_s: float) -> int | None:
    """End a worker and what it has started; return the status with which it has ended by itself by then."""
    if pid not in workers:
        return None
    deadline = time.monotonic() + wait_s
    ended, status = os.waitpid(pid, os.WNOHANG)
    while not ended and time.monotonic() < deadline:
        time.sleep(0.005)
        ended, status = os.waitpid(pid, os.WNOHANG)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)
    if not ended:
        os.waitpid(pid, 0)
    workers.discard(pid)
    _end_orphans(workers)
    return status if ended else None


def _end_orphans(workers: set[int]) -> None:
    """End what workers have left behind; the children of an orphan are orphans when it has ended."""
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    for _ in range(MOST_GENERATIONS if children.is_file() else 0):
        orphans = {int(pid) for pid in children.read_text("ascii").split()} - workers
        if not orphans:
            return
        for orphan in orphans:
            with suppress(ProcessLookupError, ChildProcessError):
                os.kill(orphan, signal.SIGKILL)
                os.waitpid(orphan, 0)


def _prctl(option: int, value: int) -> None:
    """Set an option of this process where the system has it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)
