"""Two estimators of one package never share a process: what one does to the other is not seen by it."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fdbench import registry
from fdbench.benchmark.run import run
from fdbench.benchmark.store import Store
from fdbench.benchmark.verify import verify
from fdbench.checks import check
from fdbench.metrics import metrics
from fdbench.simulate.compose import cache_folder

SCENARIO = "ShakerConstant-v1"
VICTIM, CHEAT = "keeps_to_itself", "changes_its_neighbour"
TIMED = [name for name in metrics.names() if metrics.get(name).track == "speed"]


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Store, Store]]:
    """Return the results of the one alone and of both, in workers of their own, while the package is installed."""
    folder = tmp_path_factory.mktemp("neighbours")
    shutil.copytree(Path(__file__).parent / "neighbours", folder / "neighbours")
    information = folder / "neighbours-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: neighbours\nVersion: 1.0\n", "utf-8")
    (information / "entry_points.txt").write_text("[fdbench.estimators]\nneighbours = neighbours\n", "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        registry._packages.cache_clear()
        # Other limits have other workers.
        run([SCENARIO], [VICTIM], 2, folder / "alone", time_limit_s=1001.0)
        run([SCENARIO], [CHEAT, VICTIM], 2, folder / "beside", time_limit_s=1002.0)
        yield Store(folder / "alone"), Store(folder / "beside")
    registry._packages.cache_clear()


def rows(store: Store, estimator: str) -> Any:
    """Return the rows of an estimator that do not tell time."""
    scores = store.scores()
    own = scores[(scores["estimator"] == estimator) & ~scores["metric"].isin(TIMED)]
    return own[["seed", "metric", "value", "status", "message"]].reset_index(drop=True)


def test_a_neighbour_changes_nothing_to_the_bit(stores: tuple[Store, Store]) -> None:
    alone, beside = stores
    assert (rows(alone, VICTIM)["status"] != "failed").all()
    assert rows(alone, VICTIM).equals(rows(beside, VICTIM))


def test_what_the_neighbour_does_would_be_seen_in_its_process(stores: tuple[Store, Store]) -> None:
    scores = stores[1].scores()
    errors = scores[scores["metric"] == "parameter_error"].groupby("estimator")["value"].min()
    assert errors[CHEAT] > 10.0 * errors[VICTIM]


def test_a_neighbour_leaves_nothing_where_compiled_code_is_loaded_from(stores: tuple[Store, Store]) -> None:
    assert not list((cache_folder() / "sandbox").rglob("poisoned_by_a_neighbour"))


def test_verify_and_check_keep_them_apart_too(stores: tuple[Store, Store]) -> None:
    assert verify(stores[1].folder).is_same
    assert check(VICTIM)[-1] == "has_docstring: ok"
