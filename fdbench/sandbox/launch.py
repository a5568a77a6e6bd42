"""The fork server as the side that holds the truth sees it: started, asked for workers, and ended with them."""

import json
import os
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Mapping, Sequence
from typing import IO, Any, NamedTuple

from fdbench.errors import FdbenchError
from fdbench.simulate.compose import cache_folder

_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from fdbench.sandbox.server import main; main({})"

# Of its environment, what loads libraries and settles their arithmetic, and nothing that says what is run.
_KEPT_VARIABLES = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "TMPDIR", "HOME", "SYSTEMROOT")

_KEPT_BEGINNINGS = ("NUMBA_", "NPY_", "OPENBLAS_", "MKL_", "OMP_", "KMP_")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

START_S = 120.0


class LaunchTerms(NamedTuple):
    """What a server is started with: of which process, what it may import from, and its environment."""

    pid: int
    path: tuple[str, ...]
    environment: tuple[tuple[str, str], ...]

    @classmethod
    def now(cls) -> "LaunchTerms":
        """Return the terms of a server that would be started now."""
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        kept |= {name: value for name, value in os.environ.items() if name.startswith(_KEPT_BEGINNINGS)}
        kept |= {"FDBENCH_CACHE": str(cache_folder()), **dict.fromkeys(_THREADS, "1")}
        return cls(os.getpid(), tuple(os.path.abspath(entry) for entry in sys.path), tuple(kept.items()))


class ForkServer:
    """The other end of `fdbench.sandbox.server`."""

    def __init__(self, terms: LaunchTerms) -> None:
        self.terms = terms
        self._control, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _BOOT.format(theirs.fileno()), json.dumps(terms.path)],
                stdin=subprocess.DEVNULL,
                env=dict(terms.environment),
                cwd="/",
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._close = weakref.finalize(self, _close, self._control, self._process)
        self._asking = threading.Lock()
        self._is_ready = False

    @property
    def is_alive(self) -> bool:
        """Whether it has neither been closed nor ended by itself."""
        return self._close.alive and self._process.poll() is None

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
            with self._asking:
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


_server: ForkServer | None = None


def fork_server() -> ForkServer:
    """Return the server of this process: one for all, until it ends or would be started on other terms."""
    global _server
    terms = LaunchTerms.now()
    if _server is None or not _server.is_alive or _server.terms != terms:
        _server = ForkServer(terms)
    return _server


def _close(control: socket.socket, process: "subprocess.Popen[bytes]") -> None:
    control.close()
    try:
        process.wait(START_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
