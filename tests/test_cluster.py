"""Processes that work for a command."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

WORK = """
import os
import time

from fdbench.cluster import in_processes


def work(seconds):
    time.sleep(seconds)
    return os.getpid()


for worker in in_processes(work, [0.0, 0.0, 600.0, 600.0], 2):
    print(worker, flush=True)
"""


SHARE = """
from fdbench.cluster import in_processes, processors


def share(_):
    return processors()


print(processors(), *in_processes(share, [0, 1, 2], 2))
"""


def is_alive(process: str) -> bool:
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_workers_end_with_the_process_that_was_killed(tmp_path: Path) -> None:
    file = tmp_path / "work.py"
    file.write_text(WORK)
    with subprocess.Popen(
        [sys.executable, str(file)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as main:
        assert main.stdout is not None
        workers = {main.stdout.readline().strip() for _ in range(2)}
        assert all(map(is_alive, workers))
        main.kill()
    end = time.monotonic() + 30.0
    while any(map(is_alive, workers)) and time.monotonic() < end:
        time.sleep(0.1)
    assert not any(map(is_alive, workers))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="affinity is that of Linux")
def test_each_worker_uses_a_share_of_the_processors_that_the_process_may_use(tmp_path: Path) -> None:
    file = tmp_path / "share.py"
    file.write_text(SHARE)
    allowed = os.sched_getaffinity(0)
    several = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=True).stdout.split()
    pinned = f"import os; os.sched_setaffinity(0, {{{min(allowed)}}})\n"
    file.write_text(pinned + SHARE)
    alone = subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=True).stdout.split()
    assert int(several[0]) <= len(allowed)
    assert several[1:] == 3 * [str(max(int(several[0]) // 2, 1))]
    assert alone == 4 * ["1"]
