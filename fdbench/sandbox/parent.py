"""The side that holds the truth: it starts the fork server, asks workers, measures their time and ends them."""

import os
import pickle
import re
import secrets
import shutil
import signal
import socket
import tempfile
import time
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from fdbench.errors import FdbenchError
from fdbench.estimator import Context, Estimate
from fdbench.record import FloatArray, Record
from fdbench.sandbox import landlock, seccomp
from fdbench.sandbox.fault import LONGEST_TEXT, LONGEST_TRACEBACK, is_own
from fdbench.sandbox.launch import ForkServer, fork_server
from fdbench.sandbox.memory import PeakMemory
from fdbench.sandbox.message import Reply, Unreadable, receive_answer, send_request
from fdbench.sandbox.terms import Declaration, FitResult, Misbehaved, Source, WorkerLimits
from fdbench.simulate.compose import cache_folder

LAST_MOMENT_S = 0.5

UNUSED_CACHE_S = 7 * 24 * 3600

_FRAME = re.compile(r'File "(.{1,1000}?)", line (\d+) in ')

LONGEST_LAST_WORDS = 2**16

# Which method of an estimator answers, where it has another name than the question.
METHODS = {"stream": "estimate"}


class Sandbox:
    """Workers that are made when they are needed, and ended with this object or its process.

    Parameters
    ----------
    limits : WorkerLimits
    plugins : sequence of (str, Path)
        Kind and path of the plug-in files that a context may hold: effects, motions, plants.
    """

    def __init__(self, limits: WorkerLimits, plugins: Sequence[tuple[str, Path]] = ()) -> None:
        self.limits = limits
        self._plugins = tuple((kind, str(file)) for kind, file in plugins)
        self._workers: dict[str, Worker] = {}
        weakref.finalize(self, _end_all, self._workers).atexit = False  # the server ends them with itself

    def worker(self, source: Source) -> "Worker":
        """Return the worker in which an estimator, and no other, is or is to be imported."""
        found = self._workers.get(source.name)
        if found is not None and (not found.is_alive or found.has_other(source)):
            found.end()
            found = None
        if found is None:
            found = self._workers[source.name] = Worker(fork_server(), source, self.limits, self._plugins)
        return found

    def close(self) -> None:
        """End all workers."""
        _end_all(self._workers)


class Worker:
    """One process with one plug-in."""

    def __init__(
        self, server: "ForkServer", source: Source, limits: WorkerLimits, plugins: tuple[tuple[str, str], ...]
    ) -> None:
        self._server = server
        self._limits = limits
        self._own = tuple(str(path) for path in source.own)
        self._source = source
        self._declaration: Declaration | None = None
        self._words = ""
        self.compiled: set[str] = set()
        self._last_words = tempfile.TemporaryFile()  # noqa: SIM115 (lives as long as the worker)
        self._channel, theirs = socket.socketpair()
        self._forget = weakref.finalize(self, _close_both, self._channel, self._last_words)
        with theirs:
            self._pid = server.fork(theirs, self._last_words)
        self._peak = PeakMemory(self._pid)
        self.is_alive = True
        cache = _cache(source)
        files = {"own": list(self._own), "cache": str(cache), "plugins": plugins}
        kept_by = {"has_landlock": landlock.version() > 0, "has_seccomp": seccomp.is_available()}
        self._ask({"do": "confine", "memory_MB": limits.memory_MB, **kept_by, **files})

    def has_other(self, source: Source) -> bool:
        """Return whether this worker is for other code than this."""
        return self._source != source

    def load(self, kinds: Sequence[str] = ("estimator",)) -> Declaration:
        """Import the plug-in, unless it has been, and return what it says of itself.

        Raises
        ------
        Misbehaved
            If it cannot be imported; the message begins with the name of its file.
        """
        if self._declaration is None:
            file = None if self._source.file is None else str(self._source.file)
            try:
                header = self._ask({"do": "load", "name": self._source.name, "file": file, "kinds": list(kinds)}).header
            except Misbehaved as error:
                raise Misbehaved(self._of_its_file(str(error)), error.traceback) from error
            models, announced = header.get("made_for"), header.get("expected_failures")
            places = header.get("places")
            if not (models is None or (isinstance(models, list) and all(isinstance(model, str) for model in models))):
                raise self._unreadable("the models that it is made for are no names")
            if not (isinstance(announced, dict) and all(isinstance(reason, str) for reason in announced.values())):
                raise self._unreadable("its expected failures are no reasons")
            if not (isinstance(places, dict) and all(isinstance(place, str) for place in places.values())):
                raise self._unreadable("the places of its methods are no lines")
            self._declaration = Declaration(
                kind=str(header.get("kind")),
                made_for=None if models is None else tuple(models),
                expected_failures={_clean(check): _clean(reason) for check, reason in announced.items()},
                has_docstring=header.get("has_docstring") is True,
                has_example=header.get("has_example") is True,
                is_online=header.get("is_online") is True,
                places={_clean(method): _clean(place) for method, place in places.items()},
            )
        return self._declaration

    def _of_its_file(self, message: str) -> str:
        """Return what is said of an import, beginning with the name of the file that was to be imported."""
        text = message.removeprefix("PluginError: ")
        if self._source.file is None:
            return text
        name = self._source.file.name
        text = text.removeprefix(f"{self._source.file}: ")
        return text if text.startswith(f"{name}:") else f"{name}: {text}"

    def located(self, what: str, message: str) -> str:
        """Return a message with file and line where the method begins that gives an answer, if no better is known."""
        place = "" if self._declaration is None else self._declaration.places.get(METHODS.get(what, what), "")
        return f"{place}: {message}" if place else message

    def construct(self, arguments: Mapping[str, Any]) -> None:
        """Construct the estimator, which may refuse its arguments."""
        self._ask({"do": "construct", "name": self._source.name, "arguments": dict(arguments)})

    def begin(self, arguments: Mapping[str, Any], context: Context | bytes) -> str | None:
        """Construct the estimator anew, and return why it declines a context."""
        content = context if isinstance(context, bytes) else pickle.dumps(context)
        answer = self._ask({"do": "begin", "name": self._source.name, "arguments": dict(arguments), "context": content})
        reason = answer.header.get("skip")
        return None if reason is None else _clean(str(reason))

    def fit(self, record: Record, *, is_streamed: bool = False) -> FitResult:
        """Hand over a record, without where it comes from, and have it fitted; the record's way is not timed."""
        self._ask({"do": "record", "columns": dict(record.columns)})
        self._peak.forget()
        start = time.perf_counter()
        answer = self._ask({"do": "stream" if is_streamed else "fit"})
        seconds, peak_memory_MB = time.perf_counter() - start, self._peak.size_MB()
        parameters = answer.header.get("parameters")
        if not isinstance(parameters, dict) or not all(type(value) is float for value in parameters.values()):
            raise self._unreadable("its parameters are no numbers", "fit")
        if any(_clean(name) != name for name in parameters):
            raise self._unreadable("the names of its parameters are too long or cannot be printed", "fit")
        claims = {"covariance": None, **answer.arrays}
        try:
            estimate = Estimate(parameters=parameters, **claims)
        except TypeError:
            raise self._unreadable("it has an array of another name") from None
        return FitResult(estimate=estimate, seconds=seconds, peak_memory_MB=peak_memory_MB)

    def predict(self, command: Record) -> FloatArray | None:
        """Return the response to a command that the last fit predicts."""
        return self._ask({"do": "predict", "columns": dict(command.columns)}).arrays.get("response")

    def copy(self) -> None:
        """Go on with a pickled copy of the estimator."""
        self._ask({"do": "copy"})

    def refuses_update(self, record: Record) -> bool:
        """Return whether the first sample of a record is refused before a start."""
        self._ask({"do": "record", "columns": dict(record.columns)})
        return self._ask({"do": "update"}).header.get("is_refused") is True

    def random_state(self, seed: int | None = None) -> str:
        """Seed NumPy's global generator where a seed is given, and return a digest of its state."""
        return str(self._ask({"do": "random_state", "seed": seed}).header.get("digest"))

    def wrong_examples(self) -> str:
        """Return what is wrong with the examples in the docstring, on one line; nothing if all are right."""
        return _clean(str(self._ask({"do": "examples"}).header.get("wrong")))

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

    def _ask(self, request: Mapping[str, Any]) -> Reply:
        token, limit_s, what = secrets.token_bytes(16), self._limits.time_s, str(request["do"])
        deadline = time.monotonic() + limit_s
        try:
            self._channel.settimeout(limit_s)
            send_request(self._channel, {**request, "token": token})
            answer = receive_answer(self._channel, token, deadline)
        except Unreadable as error:
            raise self._unreadable(str(error), what) from None
        except TimeoutError:
            raise self._overdue(what) from None
        except (EOFError, OSError):
            raise self._dead(what) from None
        except BaseException:
            self.end()
            raise
        reported = answer.header.get("error")
        if reported is not None:
            raise self._reported(reported, what)
        return answer

    def _reported(self, error: Any, what: str) -> Misbehaved:
        """Return the error that a worker answered a question with."""
        if not isinstance(error, dict):
            return self._unreadable("its error is no table")
        if error.get("is_fatal"):
            self.end()
        place, text = _clean(str(error.get("place", ""))), _clean(str(error.get("text", "")))
        calls = _printable(str(error.get("traceback", "")))[:LONGEST_TRACEBACK]
        return Misbehaved(f"{place}: {text}" if place else self.located(what, text), calls)

    def _unreadable(self, why: str, what: str = "") -> Misbehaved:
        self.end()
        return Misbehaved(self.located(what, f"its answer cannot be used: {_clean(why)}"))

    def _overdue(self, what: str) -> Misbehaved:
        # Its last words say where it is, unless it refuses them too.
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGABRT)
        self.end(LAST_MOMENT_S)
        return self._with_last_words(what, f"took longer than {self._limits.time_s:g} s")

    def _dead(self, what: str) -> Misbehaved:
        status = self.end(LAST_MOMENT_S)
        if status is None:
            return self._with_last_words(what, "closed the channel on which an answer is expected")
        code = os.waitstatus_to_exitcode(status)
        if code >= 0:
            return self._with_last_words(what, f"ended its process with status {code}, without an answer")
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        memory = ", by itself or for want of memory" if -code == signal.SIGKILL else ""
        return self._with_last_words(what, f"crashed with {name}{memory}")

    def _with_last_words(self, what: str, message: str) -> Misbehaved:
        words = self._words
        places = [(file, line) for file, line in _FRAME.findall(words) if is_own(file, self._own)]
        said = f"{os.path.basename(places[0][0])}:{places[0][1]}: {message}" if places else self.located(what, message)
        return Misbehaved(_clean(said), _printable(words)[:LONGEST_TRACEBACK])


def _end_all(workers: dict[str, Worker]) -> None:
    while workers:
        _, worker = workers.popitem()
        with suppress(FdbenchError):
            worker.end()


def _close_both(channel: socket.socket, last_words: IO[bytes]) -> None:
    channel.close()
    last_words.close()


def _cache(source: Source) -> Path:
    """Return the folder of compiled code of an estimator, which no other and nothing else loads from."""
    kind = "installed" if source.file is None else "files"
    folder = cache_folder() / "sandbox" / kind / (source.name if source.file is None else source.digest)
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
