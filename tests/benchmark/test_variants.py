"""Variants of estimators: one row for each set of arguments, under a name that says them."""

from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from fdbench.benchmark.console import ranking_table
from fdbench.benchmark.leaderboard import leaderboard
from fdbench.benchmark.run import run
from fdbench.benchmark.store import RunKey, Store
from fdbench.benchmark.variant import arguments, registered, variant, variants
from fdbench.errors import PluginError, SpecError, UnknownName
from fdbench.report._ranking import all_rankings, ranking_tables

pytestmark = pytest.mark.usefixtures("own_plugin_files")

# Says what it was made with; a number above 9 is refused.
TELLS = """
from fdbench.errors import SpecError
from fdbench.estimator import BatchEstimator, Estimate

class Tells(BatchEstimator):
    'Tells its arguments.'

    def __init__(self, first=1.0, second=2.0, count=3, word="a", flag=False, period_s=None):
        if first > 9.0:
            raise SpecError(f"first: {first:g} is outside [0, 9].")
        self.values = first, second

    def fit(self, context, record):
        assert all(type(value) is float for value in self.values)
        return Estimate(parameters=dict(zip(("beta_1", "beta_2"), self.values)))
"""


@pytest.fixture
def tells(tmp_path: Path) -> str:
    file = tmp_path / "tells.py"
    file.write_text(TELLS, "utf-8")
    return str(file)


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    """Return a scenario that has arguments for the estimator."""
    file = tmp_path / "Own-v0.toml"
    head = 'extends = "ShakerConstant-v1"\n[estimation.hyperparameters.tells]\n'
    file.write_text(f"{head}first = 7\nsecond = 8\n", "utf-8")
    return str(file)


def said(folder: Path, row: str) -> dict[str, float]:
    kept = Store(folder).read_estimate(RunKey("Own-v0", row, 0))
    assert kept is not None
    return dict(kept.estimate.parameters)


# ---- names ----


def test_one_variant_has_one_name() -> None:
    spellings = ("x[b=2,a=1.5]", "x[ a = 1.5 , b = 2.0 ]", "x[a=15e-1,b=2e0]", "x[b=2|2.0,a=1.5]")
    assert {tuple(variants(text)) for text in spellings} == {("x[a=1.5,b=2]",)}
    assert arguments("x[a=1.5,b=2]") == {"a": 1.5, "b": 2}
    assert registered("folder [1]/x.py[a=1]") == "folder [1]/x.py"


def test_values_keep_their_kind_and_their_digits() -> None:
    given = {"a": True, "b": None, "c": "none_such", "d": 0.1 + 0.2, "e": -3, "f": 1e300, "g": False, "h": "UI"}
    assert arguments(variant("x", given)) == given
    assert {key: type(value) for key, value in arguments(variant("x", given)).items()} == {
        key: type(value) for key, value in given.items()
    }


def test_a_grid_is_every_combination() -> None:
    assert variants("x[a=1|2,b=u|v]") == ["x[a=1,b=u]", "x[a=1,b=v]", "x[a=2,b=u]", "x[a=2,b=v]"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("krls_t[]", r"'' in the brackets; argument=value is expected"),
        ("krls_t[budget]", r"budget=: a number, true, false, none or a word is expected"),
        ("krls_t[=1]", r"'=1' in the brackets"),
        ("krls_t[budget=1,budget=2]", r"argument 'budget' is given twice; 'a\|b' tries two values"),
        ("krls_t[mode=a/b]", r"mode=a/b: a number, true, false, none or a word"),
        (f"krls_t[budget={'|'.join(map(str, range(1001)))}]", r"more than 1000 variants"),
        (f"krls_t[mode={'a' * 200}]", r"a name may have 200 bytes"),
    ],
)
def test_what_is_no_variant_is_told(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=message):
        run(["ShakerConstant-v0"], [text], 1, tmp_path / "out")
    assert not (tmp_path / "out").exists()


# ---- runs ----


def test_each_variant_is_a_row_and_its_arguments_win(tmp_path: Path, scenario: str, tells: str) -> None:
    out = tmp_path / "out"
    summary = run([scenario], [tells, f"{tells}[first=1|2]", f"{tells}[second=3,first=2.0]"], 1, out)
    assert summary.statuses == {"ok": 6, "failed": 0, "diverged": 0, "skipped": 0}
    assert said(out, "tells") == {"beta_1": 7.0, "beta_2": 8.0}
    assert said(out, "tells[first=1]") == {"beta_1": 1.0, "beta_2": 8.0}
    assert said(out, "tells[first=2]") == {"beta_1": 2.0, "beta_2": 8.0}
    assert said(out, "tells[first=2,second=3]") == {"beta_1": 2.0, "beta_2": 3.0}
    scores = Store(out).scores()
    rows = scores.drop_duplicates("estimator")
    assert rows["estimator_digest"].is_unique
    assert len(rows) == 6
    # What is not asked for this time is known by its name.
    assert run([scenario], [f"{tells}[first=2]"], 1, out).computed == 0
    assert set(Store(out).scores()["estimator"]) == set(rows["estimator"])
    console = Console(file=StringIO(), width=120)
    console.print(ranking_table(scores))
    terminal, board = console.file.getvalue(), leaderboard(Store(out))  # type: ignore[attr-defined]
    page = "".join(ranking_tables(scores, all_rankings(scores)))
    for name in ("tells", "tells[first=1]", "tells[first=2]", "tells[first=2,second=3]"):
        assert f" {name} " in terminal
        assert f"| `{name}` |" in board
        assert f'id="rank-feed-drive-{name}"' in page


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ("frist=1", PluginError, r"estimator 'tells\[frist=1\]': tells has no argument 'frist'\. Did you mean first\?"),
        ("first=word", PluginError, r"tells\.first: a number is expected, found the text 'word'"),
        ("count=0.5", PluginError, r"tells\.count: a whole number is expected, found 0\.5"),
        ("flag=1", PluginError, r"tells\.flag: true or false is expected, found 1"),
        ("word=1", PluginError, r"tells\.word: a text is expected, found 1"),
        ("first=none", PluginError, r"tells\.first: a number is expected, found None"),
        ("first=1|20", PluginError, r"estimator 'tells\[first=20\]': tells\.py:\d+: SpecError: first: 20 is outside"),
    ],
)
def test_a_wrong_argument_is_refused_before_anything_runs(
    given: str, error: type[Exception], message: str, tmp_path: Path, scenario: str, tells: str
) -> None:
    with pytest.raises(error, match=message):
        run([scenario], [f"{tells}[{given}]"], 1, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_names_that_cannot_be_variants_are_refused(tmp_path: Path, scenario: str) -> None:
    for text, error, message in (
        ("lest_squares[window_s=1]", UnknownName, "Did you mean least_squares"),
        ("oracle[a=1]", PluginError, "the benchmark's own"),
    ):
        with pytest.raises(error, match=message):
            run([scenario], [text], 1, tmp_path / "out")
    file = tmp_path / "tells[1].py"
    file.write_text(TELLS, "utf-8")
    with pytest.raises(
        PluginError, match=r"the name of the file, without .py, is that of the plug-in; allowed: up to 100"
    ):
        run([scenario], [str(file)], 1, tmp_path / "out")
