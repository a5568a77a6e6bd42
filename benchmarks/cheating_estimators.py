"""What estimators gain that look for the truth: fitted in the process that holds it, and as `fdbench run` fits them.

Prints the table of `docs/how-to/trust_of_a_rank.md`; needs the cheats of the tests, which lie in the repository.
"""

import ast
import os
import shutil
import site
import subprocess
import sys
import tempfile
from pathlib import Path

import numba

from fdbench.benchmark.run import run
from fdbench.benchmark.store import RunKey, Store
from fdbench.catalogue import PACKAGE
from fdbench.estimator import estimators
from fdbench.metrics import Outcome, metrics
from fdbench.record import Record
from fdbench.scenario import load_scenario

CHEATS = sorted((Path(__file__).parent.parent / "tests" / "sandbox" / "cheats").glob("*.py"))
SCENARIO, METRICS = "ShakerConstant-v2", ("parameter_error", "disturbance_error")


def fitted_here(file: str) -> None:
    """Print the metrics of a cheat that is fitted beside the truth."""
    scenario = load_scenario(SCENARIO)
    record, truth = scenario.observe(0)
    context = scenario.context()
    regression = context.regression(record)
    estimate = estimators.get(estimators.add_file(file))().fit(context, Record(record.columns))
    outcome = Outcome(
        scenario=scenario, record=record, regression=regression, truth=truth, estimate=estimate, seconds=1.0
    )
    print(" ".join(str(metrics.get(name)().score(outcome)) for name in METRICS))


def before(file: Path) -> list[str]:
    command = [sys.executable, __file__, str(file)]
    ended = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PWD": str(file.parent)})
    if ended.returncode:
        return ["fails"] * len(METRICS)
    return [f"{float(value):.3g} %" for value in ended.stdout.splitlines()[-1].split()]


def after(store: Store, name: str) -> list[str]:
    found = store.read_run(RunKey(SCENARIO, name, 0))
    values = {score.metric: score.value for score in found.scores} if found else {}
    return ["fails" if values.get(name) is None else f"{values[name]:.3g} %" for name in METRICS]


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    os.chdir(folder)
    os.environ["PWD"] = str(folder)
    run([SCENARIO], ["least_squares"], 1, "results")
    Path("follow_link.weights").symlink_to("results")
    files = [Path(shutil.copy(file, folder)) for file in CHEATS]
    run([SCENARIO], [str(file) for file in files], 1, "after")
    store = Store("after")
    print("| cheat | what it does | parameters | disturbance | parameters, confined | disturbance, confined |")
    print("| --- | --- | --- | --- | --- | --- |")
    for file in files:
        doc = (ast.get_docstring(ast.parse(file.read_text("utf-8"))) or "").rstrip(".")
        print(f"| `{file.stem}` | {doc} | {' | '.join([*before(file), *after(store, file.stem)])} |")
    for name in ("null", "oracle"):
        print(f"| {name} | | | | {' | '.join(after(store, name))} |")
    caches = [Path.home() / ".cache" / "fdbench", Path(numba.__file__).parent, *map(Path, site.getsitepackages())]
    for place in (*caches, Path("/tmp"), PACKAGE, PACKAGE / "effects" / "__pycache__"):
        (place / "poisoned_by_a_cheat").unlink(missing_ok=True)
    shutil.rmtree(folder)


if __name__ == "__main__":
    fitted_here(sys.argv[1]) if len(sys.argv) > 1 else main()
