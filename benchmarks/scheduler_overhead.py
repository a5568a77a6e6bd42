"""What a job costs on a Dask scheduler beside its work: the way there and back, and the writing of what comes back.

Two workers on this machine are handed a real job, of all estimators on one scenario and seed, and answer at once with
what such a job writes; nothing is simulated or fitted. CPU time is that of the command and of the scheduler, which are
one process here.

``python benchmarks/scheduler_overhead.py [JOBS]``
"""

import os
import pickle
import shutil
import sys
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from fdbench.benchmark.job import Job
from fdbench.benchmark.provenance import provenance
from fdbench.benchmark.remote import _Sent, _write
from fdbench.benchmark.run import run
from fdbench.benchmark.selection import choice_of, sources_of
from fdbench.benchmark.store import KeptRun, Store
from fdbench.cluster import Files, packed, results
from fdbench.estimator import estimators
from fdbench.scenario import load_scenario

SCENARIO = "ShakerConstant-v2"


@lru_cache
def written(folder: str) -> tuple[list[KeptRun], Files]:
    """Return what a job has written to a folder, as a worker answers it."""
    store = Store(folder)
    runs = [found for key in store.run_keys() if (found := store.read_run(key)) is not None]
    return runs, packed((path for path in store.folder.glob("*/**/*") if path.is_file()), store.folder)


def answer(sent: _Sent) -> tuple[list[KeptRun], Files]:
    """Answer as a worker does, without the work."""
    return written(sent.job.source)


def main() -> None:
    from distributed import LocalCluster

    n_jobs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    names, scenario = estimators.names(), load_scenario(SCENARIO)
    choices = tuple(choice_of(name, scenario, sources_of(names)) for name in names)
    origin = {**provenance(), "scenario_digest": scenario.content_digest, "nonce": ""}
    job = Job(source=SCENARIO, scenario=SCENARIO, seed=0, choices=choices, keep=False, provenance=origin)
    with (
        TemporaryDirectory() as place,
        LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
    ):
        kept = Path(place, "kept")
        run([SCENARIO], None, 1, kept)
        print(f"{n_jobs} jobs of {len(names)} estimators, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
        print("| answer | kB | ms a job | CPU ms a job | CPU ms of writing it |\n| --- | ---: | ---: | ---: | ---: |")
        for what in ("runs, record and estimates", "runs alone"):
            size = len(pickle.dumps(written(str(kept))))
            tasks = [_Sent(replace(job, source=str(kept), seed=seed), ()) for seed in range(n_jobs)]
            written_s, start_s, start_cpu_s = 0.0, time.perf_counter(), time.process_time()
            for sent, (_, files) in results(answer, tasks, cluster.scheduler_address):
                before_s = time.thread_time()
                _write(replace(sent.job, folder=Path(place, "out")), files)
                written_s += time.thread_time() - before_s
            times = (time.perf_counter() - start_s, time.process_time() - start_cpu_s, written_s)
            print(f"| {what} | {size / 1e3:.0f} | {' | '.join(f'{1e3 * t / n_jobs:.1f}' for t in times)} |", flush=True)
            for folder in ("records", "estimates"):
                shutil.rmtree(kept / folder, ignore_errors=True)
            kept = kept.rename(kept.with_name("runs alone"))
            written.cache_clear()


if __name__ == "__main__":
    main()
