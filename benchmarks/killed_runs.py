"""Kill runs at random instants, start each again until it ends, and compare it with one that was not killed.

`python benchmarks/killed_runs.py --kills 1000` prints how many kills there were and each defect once: other scores than
without a kill, a command that ends with an error, processes that outlive their parent by more than `PATIENCE_S`. Exits
with 1 where there is one. Needs Linux.
"""

import argparse
import ctypes
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import pandas as pd
from pandas.testing import assert_frame_equal

PATIENCE_S = 10.0
CHILD_SUBREAPER = 36
SCENARIOS = ("ShakerConstant-v2", "SlotMilling-v2")
ESTIMATORS = ("least_squares", "null")
OPTIONS = [
    *(word for name in SCENARIOS for word in ("--scenario", name)),
    *(word for name in ESTIMATORS for word in ("--estimator", name)),
    *("--seeds", "6", "--no-report"),
]


def started(folder: Path) -> subprocess.Popen[bytes]:
    """Start the run."""
    command = [str(Path(sys.executable).with_name("fdbench")), "run", *OPTIONS, "--out", str(folder)]
    with (folder / "output.txt").open("ab") as output:
        return subprocess.Popen(command, stdout=output, stderr=output)


def left_alive() -> int:
    """Return how many processes there are, beside this one, after `PATIENCE_S`."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass
        except ChildProcessError:
            return 0
        if time.monotonic() > end:
            return len(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())
        time.sleep(0.05)


def scores(folder: Path) -> pd.DataFrame:
    """Return the table of results without what is measured of the machine, in one order."""
    table = pd.read_parquet(folder / "scores.parquet")
    kept = [name for name in table.columns if not any(word in name for word in ("second", "memory", "_at", "host"))]
    return table[kept].sort_values(["scenario", "estimator", "seed"], ignore_index=True)


def main() -> int:
    """Kill until there were as many kills as asked for, print what was found, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, kills, runs, defects = random.Random(given.seed), 0, 0, Counter[str]()
    ctypes.CDLL(None, use_errno=True).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)  # what is left by a killed run comes here
    with tempfile.TemporaryDirectory() as place:
        for name in ("compiles", "reference"):
            reference, start = Path(place) / name, time.monotonic()
            reference.mkdir()
            if started(reference).wait():
                print((reference / "output.txt").read_text())
                return 1
            longest = time.monotonic() - start
        expected = scores(reference)
        print(f"{len(expected)} rows; killed within {longest:.1f} s", flush=True)
        while kills < given.kills:
            folder = Path(place) / str(runs)
            folder.mkdir()
            while True:
                process = started(folder)
                try:
                    if code := process.wait(rng.uniform(0.0, 1.2 * longest)):
                        defects[f"exit {code}: {(folder / 'output.txt').read_text()[-500:]}"] += 1
                    break
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                    kills += 1
                    if number := left_alive():
                        defects[f"{number} processes outlive a killed run by {PATIENCE_S:g} s"] += 1
            try:
                assert_frame_equal(scores(folder), expected, check_exact=True)
            except (AssertionError, OSError, ValueError) as error:
                defects[f"other scores: {error}"] += 1
            runs += 1
            print(f"{kills} kills, {runs} runs, {sum(defects.values())} defects", flush=True)
    for defect, times in defects.items():
        print(f"{times} x {defect}")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
