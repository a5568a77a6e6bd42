"""Work in processes of this machine, or on the workers of a Dask scheduler, which need not share a folder with it."""

import atexit
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from fdbench.errors import FdbenchError

Task = TypeVar("Task")
Result = TypeVar("Result")

# Paths and contents of files, as they travel.
Files = tuple[tuple[str, bytes], ...]

AHEAD = 4  # tasks handed out for each thread of a worker, so that none waits for the next one

CONNECT_S = 20.0

REFRESH_S = 1.0

WATCHED_S = 1.0  # how often a worker looks whether the process that started it lives


@lru_cache(maxsize=1)
def processors() -> int:
    """Return how many processors this process may use: what affinity and control groups leave it, or its share."""
    from joblib import cpu_count

    found: int = cpu_count()
    return found


def in_processes(function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int) -> Iterator[Result]:
    """Yield the results of tasks as they come from processes on this machine.

    Raises
    ------
    FdbenchError
        If a process dies, or ``function`` raises.
    """
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import BrokenProcessPool

    n_jobs = min(jobs, max(len(tasks), 2))
    begins: Any = {"initializer": _begin, "initargs": (os.getpid(), max(processors() // n_jobs, 1))}
    parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered", **begins)
    try:
        yield from parallel(delayed(function)(task) for task in tasks)
    except BrokenProcessPool as error:
        raise FdbenchError(
            "a worker process died, by a crash in compiled code or for want of memory. What was finished is kept; "
            "start again with --jobs 1 to see where it is."
        ) from error


def _begin(parent: int, share: int) -> None:
    """Let this process use a share of the processors, and end with the one that started it."""
    os.environ["LOKY_MAX_CPU_COUNT"] = str(share)
    _end_with(parent)


def _end_with(parent: int) -> None:
    """End this process soon after the one that started it: where that is killed, a queue's pipe may never end."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCHED_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def results(
    function: Callable[[Task], Result], tasks: Sequence[Task], scheduler: str, name: Callable[[Task], str] = str
) -> Iterator[tuple[Task, Result]]:
    """Yield each task with its result, as they come.

    A task whose worker dies is done by another one. What was yielded before an error is done.

    Parameters
    ----------
    function : callable
        Importable by the workers.
    tasks : sequence
    scheduler : str
        Address, such as ``tcp://host:8786``.
    name : callable
        What a message calls a task.

    Raises
    ------
    FdbenchError
        If Dask is not installed, no scheduler answers, a task ends one worker after another, or ``function`` raises.
    """
    with _connected(scheduler) as client:
        from distributed import as_completed
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        waiting = iter(tasks)
        running: dict[Any, Task] = {}
        most, asked_s = 0, -REFRESH_S

        def handed_out() -> list[Any]:
            nonlocal most, asked_s
            if time.monotonic() > asked_s + REFRESH_S:  # workers come and go
                most, asked_s = AHEAD * max(1, sum(client.nthreads().values())), time.monotonic()
            number = max(0, most - len(running))
            found = {client.submit(function, task, pure=False): task for task in islice(waiting, number)}
            running.update(found)
            return list(found)

        error: BaseException | None = None
        try:
            done = as_completed(handed_out())
            for future in done:
                task, error = running.pop(future), future.exception()
                if error is not None:
                    break
                yield task, future.result()
                done.update(handed_out())
        except OSError as lost:
            error = lost
        if isinstance(error, KilledWorker):
            raise FdbenchError(
                f"{name(task)}: {error.allowed_failures + 1} workers died over it, by a crash in compiled code or for "
                "want of memory. What was finished is kept."
            ) from error
        if isinstance(error, FutureCancelledError | OSError) and client.status != "running":
            raise FdbenchError(
                f"the scheduler at {scheduler} is gone: {error}. What was finished is kept: run it again."
            ) from error
        if error is not None:
            raise error


@contextmanager
def _connected(scheduler: str) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise FdbenchError("--scheduler needs Dask, which is not installed: pip install 'fdbench[dask]'.") from error
    try:
        client = Client(scheduler, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise FdbenchError(
            f"--scheduler {scheduler}: no Dask scheduler answers there: {error}. An address is as in tcp://host:8786."
        ) from error
    with client:
        yield client


_alone = threading.Lock()


@contextmanager
def alone() -> Iterator[Path]:
    """Yield an empty folder to one task of this process at a time, whose arithmetic is that of one thread.

    A process registers plug-ins once for all its threads.
    """
    from threadpoolctl import threadpool_limits

    with _alone, threadpool_limits(1, user_api="blas"), tempfile.TemporaryDirectory(prefix="fdbench-task-") as place:
        yield Path(place)


def packed(paths: Iterable[Path], below: Path = Path("/")) -> Files:
    """Return files to send, with their paths below a folder."""
    return tuple((str(path.relative_to(below)), path.read_bytes()) for path in dict.fromkeys(paths))


def unpack(files: Files, folder: Path) -> None:
    """Write files that were sent below a folder."""
    for path, content in files:
        place = folder / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)


@lru_cache(maxsize=32)
def unpacked(files: Files) -> Path:
    """Return a folder of this process with files that were sent, the same as long as they are the same."""
    folder = Path(tempfile.mkdtemp(prefix="fdbench-sent-")).resolve()
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    unpack(files, folder)
    return folder
