"""The side that holds the truth: it starts the fork server, asks workers, measures their time and ends them."""

import glob
import json
import os
import pickle
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from fdbench.errors import FdbenchError, PluginError
from fdbench.estimator import Context, Estimate
from fdbench.record import FloatArray, Record
from fdbench.sandbox.message import Answer, Unreadable, receive_answer, send_request
from fdbench.sandbox.worker import LONGEST_TEXT, LONGEST_TRACEBACK, is_own
from fdbench.simulate.compose import cache_folder

_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from fdbench.sandbox.server import main; main({})"

# Of its environment, what loads libraries and settles their arithmetic, and nothing that says what is run.
_KEPT_VARIABLES = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "TMPDIR", "HOME", "SYSTEMROOT")

_KEPT_BEGINNINGS = ("NUMBA_", "NPY_", "OPENBLAS_", "MKL_", "OMP_", "KMP_")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

START_S, LAST_MOMENT_S = 120.0, 0.5

UNUSED_CACHE_S = 7 * 24 * 3600

_FRAME = re.compile(r'File "(.{1,1000}?)", line (\d+) in ')

LONGEST_LAST_WORDS = 2**16


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How long one fit may take, and how much memory a worker may have."""

    time_s: float = 300.0
    memory_MB: float = 4096.0


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where an estimator is.

    Attributes
    ----------
    name : str
    own : tuple of Path
        Its file, or the folders of the package that it is in; errors are located in these.
    group : str
        Estimators of one group share a worker: the name of their top-level package, or the file.
    digest : str
        Of its code; a worker that has imported another one is not used any more.
    file : Path or None
        Its file, where it has no package.
    """

    name: str
    own: tuple[Path, ...]
    group: str
    digest: str
    file: Path | None = None


class Misbehaved(PluginError):
    """An estimator failed, crashed or went beyond a limit.

    Attributes
    ----------
    traceback : str
        The calls that led there, as far as they are known.
    """

    def __init__(self, message: str, traceback: str = "") -> None:
        super().__init__(message)
        self.traceback = traceback


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """What came back from a fit: nothing but numbers, whose names and shapes are still to be checked."""

    estimate: Estimate
    seconds: float


class Sandbox:
    """Workers of one process; made when they are needed, and ended with this object or its process.

    Parameters
    ----------
    limits : Limits
    plugins : sequence of (str, Path)
        Kind and path of the plug-in files that a context may hold: effects, motions, plants.
    """

    def __init__(self, limits: Limits, plugins: Sequence[tuple[str, Path]] = ()) -> None:
        self.limits = limits
        self._plugins = tuple((kind, str(file)) for kind, file in plugins)
        self._server: _Server | None = None
        self._workers: dict[str, Worker] = {}

    def worker(self, source: Source) -> "Worker":
        """Return the worker in which an estimator is, or is to be, imported."""
        found = self._workers.get(source.group)
        if found is not None and (not found.is_alive or found.has_other(source)):
            found.end()
            found = None
        if found is None:
            if self._server is None or not self._server.is_alive:
                self._server = _Server()
            found = self._workers[source.group] = Worker(self._server, source, self.limits, self._plugins)
        return found

    def close(self) -> None:
        """End the server and all workers."""
        if self._server is not None:
            self._server.close()
        self._server, self._workers = None, {}


class Worker:
    """One process with the plug-ins of a group."""

    def __init__(self, server: "_Server", source: Source, limits: Limits, plugins: tuple[tuple[str, str], ...]) -> None:
        self._server = server
        self._limits = limits
        self._own = tuple(str(path) for path in source.own)
        self._loaded: dict[str, str] = {}
        self._words = ""
        self.compiled: set[str] = set()
        self.made_for: dict[str, tuple[str, ...] | None] = {}
        self._last_words = tempfile.TemporaryFile()  # noqa: SIM115 (lives as long as the worker)
        self._channel, theirs = socket.socketpair()
        self._forget = weakref.finalize(self, _close_both, self._channel, self._last_words)
        with theirs:
            self._pid = server.fork(theirs, self._last_words)
        self.is_alive = True
        cache = _cache(source)
        readable = [*self._own, *(str(path) for path in _beside(source.file))]
        files = {"own": list(self._own), "read": readable, "cache": str(cache), "plugins": plugins}
        self._ask({"do": "confine", "memory_MB": limits.memory_MB, **files})

    def has_other(self, source: Source) -> bool:
        """Return whether this worker has imported an estimator of this name from other code."""
        return self._loaded.get(source.name, source.digest) != source.digest

    def load(self, source: Source, kinds: Sequence[str] = ("estimator",)) -> str:
        """Import a plug-in, and return of which kind it is."""
        if source.name in self._loaded:
            return "estimator"
        file = None if source.file is None else str(source.file)
        answer = self._ask({"do": "load", "name": source.name, "file": file, "kinds": list(kinds)})
        models = answer.header.get("made_for")
        if not (models is None or (isinstance(models, list) and all(isinstance(model, str) for model in models))):
            raise self._unreadable("the models that it is made for are no names")
        self.made_for[source.name] = None if models is None else tuple(models)
        self._loaded[source.name] = source.digest
        return str(answer.header.get("kind"))

    def begin(self, name: str, arguments: Mapping[str, Any], context: Context | bytes) -> str | None:
        """Construct an estimator, and return why it declines a context."""
        content = context if isinstance(context, bytes) else pickle.dumps(context)
        answer = self._ask({"do": "begin", "name": name, "arguments": dict(arguments), "context": content})
        reason = answer.header.get("skip")
        return None if reason is None else _clean(str(reason))

    def fit(self, record: Record) -> Fit:
        """Hand over a record, without where it comes from, and have it fitted; the record's way is not timed."""
        self._ask({"do": "record", "columns": dict(record.columns)})
        start = time.perf_counter()
        answer = self._ask({"do": "fit"})
        seconds = time.perf_counter() - start
        parameters = answer.header.get("parameters")
        if not isinstance(parameters, dict) or not all(type(value) is float for value in parameters.values()):
            raise self._unreadable("its parameters are no numbers")
        claims = {"covariance": None, **answer.arrays}
        try:
            estimate = Estimate(parameters=parameters, **claims)
        except TypeError:
            raise self._unreadable("it has an array of another name") from None
        return Fit(estimate=estimate, seconds=seconds)

    def predict(self, command: Record) -> FloatArray | None:
        """Return the response to a command that the last fit predicts."""
        return self._ask({"do": "predict", "columns": dict(command.columns)}).arrays.get("response")

    def end(self, wait_s: float = 0.0) -> int | None:
        """End the process; return the status with which it had ended by itself."""
        if not self.is_alive:
            return None
        self.is_alive = False
        self._channel.shutdown(socket.SHUT_RDWR)
        status = self._server.end(self._pid, wait_s)
        self._words = os.pread(self._last_words.fileno(), LONGEST_LAST_WORDS, 0).decode("utf-8", "replace")
        self._forget()
        return status

    # ---- questions and answers ----

    def _ask(self, request: Mapping[str, Any]) -> Answer:
        token, limit_s = secrets.token_bytes(16), self._limits.time_s
        deadline = time.monotonic() + limit_s
        try:
            self._channel.settimeout(limit_s)
            send_request(self._channel, {**request, "token": token})
            answer = receive_answer(self._channel, token, deadline)
        except Unreadable as error:
            raise self._unreadable(str(error)) from None
        except TimeoutError:
            raise self._overdue() from None
        except (EOFError, OSError):
            raise self._dead() from None
        except BaseException:
            self.end()
            raise
        reported = answer.header.get("error")
        if reported is not None:
            raise self._reported(reported)
        return answer

    def _reported(self, error: Any) -> Misbehaved:
        """Return the error that a worker answered with."""
        if not isinstance(error, dict):
            return self._unreadable("its error is no table")
        if error.get("is_fatal"):
            self.end()
        place, text = _clean(str(error.get("place", ""))), _clean(str(error.get("text", "")))
        calls = _printable(str(error.get("traceback", "")))[:LONGEST_TRACEBACK]
        return Misbehaved(f"{place}: {text}" if place else text, calls)

    def _unreadable(self, what: str) -> Misbehaved:
        self.end()
        return Misbehaved(f"its answer cannot be used: {_clean(what)}")

    def _overdue(self) -> Misbehaved:
        # Its last words say where it is, unless it refuses them too.
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGABRT)
        self.end(LAST_MOMENT_S)
        return self._with_last_words(f"took longer than {self._limits.time_s:g} s")

    def _dead(self) -> Misbehaved:
        status = self.end(LAST_MOMENT_S)
        if status is None:
            return self._with_last_words("closed the channel on which an answer is expected")
        code = os.waitstatus_to_exitcode(status)
        if code >= 0:
            return self._with_last_words(f"ended its process with status {code}, without an answer")
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        memory = ", by itself or for want of memory" if -code == signal.SIGKILL else ""
        return self._with_last_words(f"crashed with {name}{memory}")

    def _with_last_words(self, message: str) -> Misbehaved:
        words = self._words
        places = [(file, line) for file, line in _FRAME.findall(words) if is_own(file, self._own)]
        place = f"{os.path.basename(places[0][0])}:{places[0][1]}: " if places else ""
        return Misbehaved(_clean(f"{place}{message}"), _printable(words)[:LONGEST_TRACEBACK])


class _Server:
    """The fork server's other end."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair()
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        kept |= {name: value for name, value in os.environ.items() if name.startswith(_KEPT_BEGINNINGS)}
        kept.pop("NUMBA_CACHE_DIR", None)
        path = [os.path.abspath(entry) for entry in sys.path]
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-I", "-c", _BOOT.format(theirs.fileno()), json.dumps(path)],
                stdin=subprocess.DEVNULL,
                env={**kept, **dict.fromkeys(_THREADS, "1")},
                cwd="/",
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._close = weakref.finalize(self, _close, self._control, process)
        self._is_ready = False

    @property
    def is_alive(self) -> bool:
        return self._close.alive

    def fork(self, channel: socket.socket, last_words: IO[bytes]) -> int:
        """Fork a worker that holds these, and return its process."""
        return int(self._ask({"do": "fork"}, [channel.fileno(), last_words.fileno()])["pid"])

    def end(self, pid: int, wait_s: float) -> int | None:
        """End a worker; return the status with which it ended by itself within a time."""
        if not self.is_alive:
            return None
        status: int | None = self._ask({"do": "end", "pid": pid, "wait_s": wait_s})["status"]
        return status

    def close(self) -> None:
        """End the server, which ends its workers."""
        self._close()

    def _ask(self, request: Mapping[str, Any], descriptors: Sequence[int] = ()) -> dict[str, Any]:
        try:
            if not self._is_ready:
                self._answer()
                self._is_ready = True
            socket.send_fds(self._control, [json.dumps(request).encode()], list(descriptors))
            return self._answer()
        except (OSError, EOFError) as error:
            self.close()
            raise FdbenchError(
                "the process that starts those of the estimators has died; what it said is above. What was finished is "
                "kept: run it again."
            ) from error
        except BaseException:
            self.close()  # interrupted between question and answer
            raise

    def _answer(self) -> dict[str, Any]:
        content = b""
        self._control.settimeout(START_S)
        while not content.endswith(b"\n"):
            part = self._control.recv(4096)
            if not part:
                raise EOFError
            content += part
        answer: dict[str, Any] = json.loads(content)
        return answer


def _close_both(channel: socket.socket, last_words: IO[bytes]) -> None:
    channel.close()
    last_words.close()


def _close(control: socket.socket, process: "subprocess.Popen[bytes]") -> None:
    control.close()
    try:
        process.wait(START_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _beside(file: Path | None) -> list[Path]:
    """Return the files beside a plug-in's that bear its name, such as weights."""
    return [] if file is None else sorted(file.parent.glob(f"{glob.escape(file.stem)}.*"))


def _cache(source: Source) -> Path:
    """Return the folder of compiled code of a group, which no other group and nothing else loads from."""
    kind = "packages" if source.file is None else "files"
    folder = cache_folder() / "sandbox" / kind / (source.group if source.file is None else source.digest)
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    if source.file is not None:
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > UNUSED_CACHE_S:
                shutil.rmtree(other, ignore_errors=True)
    return folder


def _clean(text: str) -> str:
    return " ".join(_printable(text).split())[:LONGEST_TEXT]


def _printable(text: str) -> str:
    return "".join(character for character in text if character.isprintable() or character == "\n")
