"""Every scenario file holds the shared checks, and a released one never changes."""

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import pytest
from conftest import REPOSITORY

from fdbench.checks.check_scenario import CHECKS, CheckedScenario
from fdbench.errors import MissingData, SpecError
from fdbench.scenario import load_scenario, scenario_ids

DIGESTS = REPOSITORY / "tests" / "golden" / "scenario_digests.json"


@lru_cache(maxsize=1)
def subject(name: str) -> CheckedScenario:
    return CheckedScenario(load_scenario(name))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", scenario_ids())
def test_scenario(name: str, check: Callable[[CheckedScenario], None]) -> None:
    checked = subject(name)
    if checked.scenario.measured is not None:
        try:
            checked.observed  # noqa: B018
        except MissingData as missing:
            pytest.skip(str(missing))
    check(checked)


def test_released_scenarios_are_frozen() -> None:
    released = json.loads(DIGESTS.read_text())
    now = {name: load_scenario(name).digest for name in scenario_ids()}
    assert now == released, "a released scenario changed: make it a new version instead"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg", "mas_kg", r"plant\.motor\.mas_kg: unknown key for linear_motor\. Did you mean mass_kg \[kg\]\?"),
        ("mass_kg = 20.0", "", r"plant\.motor\.mass_kg: missing key \[kg\] of linear_motor"),
        ("mass_kg = 20.0", "mass_kg = -20.0", r"plant\.motor\.mass_kg: -20 is outside \(0, inf\) kg"),
        ("mass_kg = 20.0", 'mass_kg = "20"', r"plant\.motor\.mass_kg: a number in kg is expected, found the text '20'"),
        ("mass_kg = 20.0", "mass_kg = true", r"plant\.motor\.mass_kg: a number in kg is expected"),
        (
            'kind = "feed_drive"',
            'kind = "fed_drive"',
            r"plant\.kind: unknown plant 'fed_drive'\. Did you mean feed_drive",
        ),
        (
            "coulomb_force_N",
            "columb_force_N",
            r"plant\.effects\[0\]\.columb_force_N: unknown key .* coulomb_force_N \[N\]",
        ),
        ("frequency_Hz = 55.0", "frequency_Hz = 1e5", r"reality\.effects\[0\]\.frequency_Hz: 100000 is outside"),
        ('model = "velocity_loop"', 'model = "velocity"', r"estimation\.model: the plant offers no model 'velocity'"),
        ('tracks = ["parameters"', 'tracks = ["params"', r"tracks: unknown track 'params'\. Did you mean parameters"),
        ("[timing]", "[timin]", r"timin: unknown key .* Did you mean timing"),
        ("title = ", "title == ", r"not valid TOML"),
    ],
)
def test_a_faulty_scenario_is_told_what_is_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    from fdbench.scenario import scenario_folder

    text = (scenario_folder() / "ShakerConstant-v0.toml").read_text()
    assert old in text
    file = tmp_path / "Broken-v0.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(SpecError, match=message):
        load_scenario(file)


def test_a_substep_that_is_too_long_is_refused(tmp_path: Path) -> None:
    from fdbench.scenario import scenario_folder

    text = (scenario_folder() / "BallScrewAxis-v0.toml").read_text()
    file = tmp_path / "Coarse-v0.toml"
    file.write_text(
        text.replace("substeps = 10", "substeps = 1").replace("stiffness_N_per_m = 2e7", "stiffness_N_per_m = 9e8")
    )
    with pytest.raises(SpecError, match=r"largest stable substep is .* at least \d+ substeps"):
        load_scenario(file).observe(0)
