"""Every registered metric, plant, motion and diagnoser holds its shared checks, and faulty ones are told why."""

import dataclasses
from dataclasses import dataclass
from typing import final

import numpy as np
import pytest

from fdbench import checks
from fdbench.checks import check_diagnoser, check_metric, check_motion, check_plant, check_task
from fdbench.envs.tasks import tasks
from fdbench.errors import PluginError, UnknownName
from fdbench.metrics import Metric, metrics
from fdbench.motions import Motion, motions
from fdbench.plants import plants
from fdbench.trials.diagnoser import CaseAnswer, Diagnoser, diagnosers

QUICK = ("null", "random", "recalibration_only", "largest_correlation", "sparse_regression")


@pytest.mark.parametrize("name", metrics.names())
def test_metric(name: str) -> None:
    lines = check_metric.check_metric(metrics.get(name))
    assert len(lines) == len(check_metric.CHECKS)


@pytest.mark.parametrize("name", motions.names())
def test_motion(name: str) -> None:
    assert all(line.endswith(": ok") for line in check_motion.check_motion(motions.get(name)))


@pytest.mark.parametrize("name", plants.names())
def test_plant(name: str) -> None:
    assert all(line.endswith(": ok") for line in check_plant.check_plant(plants.get(name)))


@pytest.mark.parametrize("name", tasks.names())
def test_task(name: str) -> None:
    assert all(line.endswith(": ok") for line in check_task.check_task(tasks.get(name)))


@pytest.mark.parametrize("name", QUICK)
def test_diagnoser(name: str) -> None:
    assert all(line.endswith(": ok") for line in check_diagnoser.check_diagnoser(diagnosers.get(name)))


def test_a_name_has_the_checks_of_its_kind() -> None:
    assert checks.check("standstill") == check_motion.check_motion(motions.get("standstill"))
    assert "is_the_same_again: ok" in checks.check("sensor_network")
    with pytest.raises(UnknownName, match="Did you mean standstill"):
        checks.check("standstil")


@final
@dataclass(frozen=True, kw_only=True)
class Jumping(Motion):
    """Claims a velocity that it does not have."""

    name = "jumping"

    def reference(self, period_s: float, n_samples: int) -> np.ndarray:
        return np.column_stack((np.arange(n_samples) * period_s, np.zeros((n_samples, 2))))


def test_a_faulty_motion_is_told_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Jumping, "__doc__", ">>> 1 + 1\n3\n")
    case = check_motion.CheckedMotion(Jumping, Jumping())
    with pytest.raises(PluginError, match=r"between samples \d+ and \d+ the velocity is 1 m/s off"):
        check_motion.moves_by_its_velocity(case)
    with pytest.raises(PluginError, match="the example in the docstring is wrong"):
        check_motion.is_documented(case)


def test_a_metric_that_prefers_zeros_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = metrics.get("parameter_error")
    case = check_metric.prepare(kind)
    monkeypatch.setattr(kind, "score", lambda self, outcome: abs(next(iter(outcome.estimate.parameters.values()))))
    with pytest.raises(PluginError, match="zeros score 0, better than the truth"):
        check_metric.ranks_nothing_below_the_truth(case)
    monkeypatch.setattr(kind, "track", "speeed")
    with pytest.raises(PluginError, match="track 'speeed' is none of"):
        check_metric.says_what_it_is(dataclasses.replace(case))


def test_a_metric_without_an_example_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = metrics.get("parameter_error")
    monkeypatch.setattr(kind, "__doc__", (kind.__doc__ or "").split("Examples")[0])
    with pytest.raises(PluginError, match="the docstring lacks '>>>'"):
        check_metric.is_documented(check_metric.CheckedMetric(kind, None))


class Careless(Diagnoser):
    """Names what is no effect, and changes records."""

    name = "careless"

    def diagnose(self, nominal: object, records: object, holdouts: object) -> CaseAnswer:
        return CaseAnswer(effects={"gremlins": 0.9})


def test_a_faulty_diagnoser_is_told_what_is_wrong() -> None:
    with pytest.raises(PluginError, match="names gremlins, which is no effect"):
        check_diagnoser.answers_with_probabilities(check_diagnoser.CheckedDiagnoser(Careless))


def test_bases_are_abstract() -> None:
    with pytest.raises(TypeError):
        Metric()  # type: ignore[abstract]
