"""Processor time and memory of the quick suite, with estimators in workers and in the process that scores.

Prints the table of `docs/how-to/trust_of_a_rank.md`. In the first run of each the cache of compiled code is empty, in
the second it is full; linear algebra has one thread in both. Memory is that of all processes, pages that some share
counted once; needs Linux. ``python benchmarks/sandbox_cost.py with`` measures one of the two alone.
"""

import ctypes
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fdbench.benchmark import job, run
from fdbench.benchmark.suite import SEEDS, Suite, in_suite
from fdbench.benchmark.validate import check_estimate, plant_parameters
from fdbench.estimator import construct, estimators
from fdbench.record import FloatArray, Record
from fdbench.sandbox import FitResult
from fdbench.sandbox.launch import _THREADS

MODES = ("without", "with")

CHILD_SUBREAPER = 36

PAUSE_S = 2.0

confined = job._estimate

compiled = set[str]()


def fitted_here(choice: job.Choice, trial: Any, own: job.Job) -> tuple[FitResult, FloatArray | None]:
    """Do what a worker does, in this process."""
    if choice.source is None:
        return confined(choice, trial, own)
    estimator, context = construct(choice.name, choice.arguments), trial.context
    kinds = type(estimator).made_for
    is_other = kinds is not None and not {context.model, context.plant.name}.intersection(kinds)
    reason = "made for others" if is_other else estimator.skip(context)
    if reason is not None:
        raise job._Skip(reason)
    if choice.digest not in compiled:
        estimator.fit(context, Record(trial.record.columns))
        compiled.add(choice.digest)
        estimator = construct(choice.name, choice.arguments)
    start = time.perf_counter()
    estimate = estimator.fit(context, Record(trial.record.columns))
    seconds = time.perf_counter() - start
    check_estimate(estimate, trial.regression, plant_parameters(context))
    response = None if trial.command is None else estimator.predict(context, estimate, trial.command)
    return FitResult(estimate=estimate, seconds=seconds, peak_memory_MB=None), response


def made_for(sources: Mapping[str, object], *_: object) -> dict[str, tuple[str, ...] | None]:
    return {name: estimators.get(name).made_for for name in sources}


def quick_suite(mode: str, out: str) -> None:
    if mode == "without":
        job._estimate, run.made_for = fitted_here, made_for  # type: ignore[assignment, attr-defined]
    print(dict(run.run(in_suite(Suite.QUICK), None, SEEDS[Suite.QUICK], out).statuses))


def with_descendants(pid: int) -> list[int]:
    found = [pid]
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            found += [each for child in children.read_text("ascii").split() for each in with_descendants(int(child))]
        except OSError:
            continue  # it has ended
    return found


def memory_MB(pid: int) -> float:
    total = 0.0
    for each in with_descendants(pid):
        try:
            lines = Path(f"/proc/{each}/smaps_rollup").read_text("ascii").splitlines()
        except OSError:
            continue
        total += sum(1.024e-3 * float(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total


def processor_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measured(mode: str, cache: str) -> tuple[float, float]:
    """Return processor time in s and largest memory in MB of a run and of all that it starts."""
    out, before, peak_MB = tempfile.mkdtemp(), processor_s(), 0.0
    environment = {**os.environ, **dict.fromkeys(_THREADS, "1"), "FDBENCH_CACHE": cache, "NUMBA_CACHE_DIR": cache}
    main = subprocess.Popen([sys.executable, __file__, mode, out], env=environment)
    while main.poll() is None:
        peak_MB = max(peak_MB, memory_MB(main.pid))
        time.sleep(PAUSE_S)
    try:
        while True:
            os.wait()  # orphans come here, and their time with them
    except ChildProcessError:
        shutil.rmtree(out)
        return processor_s() - before, peak_MB


def main(modes: Sequence[str]) -> None:
    ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)
    print("| workers | cache | processor time | memory |\n| --- | --- | --- | --- |", flush=True)
    for mode in modes:
        cache = tempfile.mkdtemp()
        for content in ("empty", "full"):
            time_s, peak_MB = measured(mode, cache)
            print(f"| {mode} | {content} | {time_s:.0f} s | {peak_MB:.0f} MB |", flush=True)
        shutil.rmtree(cache)


if __name__ == "__main__":
    quick_suite(*sys.argv[1:]) if len(sys.argv) == 3 else main(sys.argv[1:] or MODES)
