"""Processes that work for a command."""

import subprocess
import sys
import time
from pathlib import Path

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
