"""Of what type the rest of a gap is."""

import numpy as np
import pytest

from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.judge.residual_dependence import dependences
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.specification import load_toml, read
from fdbench.virtual_axes import cases as tiers

PERIOD_S = 1e-3
LEAD_M = 0.01
STROKES = moves((0.0, 0.15, 0.02, 0.1, 0.0), (0.1, 0.03, 0.2, 0.01), 4.0, PERIOD_S)
RESTS = {
    "velocity": lambda x, v, a, t: 8.0 * np.exp(-np.abs(v) / 0.02) * np.sign(v) * (v != 0.0),
    "position": lambda x, v, a, t: 8.0 * np.sin(x / 0.03),
    "position_by_direction": lambda x, v, a, t: 8.0 * np.sin(x / 0.03) * np.sign(v),
    "acceleration": lambda x, v, a, t: 3.0 * a,
    "time": lambda x, v, a, t: 0.5 * t,
    "position_within_a_lead": lambda x, v, a, t: 8.0 * np.sin(2.0 * np.pi * x / LEAD_M),
}


def split_of(rest: np.ndarray, rng: np.random.Generator) -> tuple[Split, list[dict[str, np.ndarray]]]:
    """Return two runs of strokes, the second held out, and what the model has of them."""
    runs = []
    for _ in range(2):
        force = 20.0 * np.sin(STROKES[:, 0] / 0.05)
        channels = {"motor_force_N": force + rest + rng.standard_normal(len(rest)), "position_m": STROKES[:, 0]}
        runs.append(RecordedRun(name="strokes", period_s=PERIOD_S, reference=STROKES, channels=channels, lap=None))
    held_out = [np.full(len(rest), out) for out in (False, True)]
    noise_models = {"motor_force_N": white(1.0, measured=True), "position_m": white(1e-7, measured=True)}
    model = {"motor_force_N": force, "position_m": STROKES[:, 0] + 1e-7}
    return Split(runs=runs, held_out=held_out, noise_models=noise_models), [model, model]


@pytest.mark.parametrize("kind", RESTS)
def test_the_rest_is_a_function_of_what_made_it(kind: str) -> None:
    drive = read(Nominal, load_toml(tiers.AXIS), "axis.toml").drive
    x, v, a = STROKES.T
    split, simulated = split_of(RESTS[kind](x, v, a, np.arange(len(x)) * PERIOD_S), np.random.default_rng(0))
    best, *others = dependences(split, simulated, drive)
    assert best.function_of == kind
    assert float(best.share) > 0.7
    shares = [item.share for item in others if item.function_of != "position_by_direction"]
    assert shares == sorted(shares, reverse=True)


def test_what_each_direction_takes_a_little_more_of_is_a_function_of_position() -> None:
    drive = read(Nominal, load_toml(tiers.AXIS), "axis.toml").drive
    x, v = STROKES.T[:2]
    rest = np.sin(x / 0.03) * (8.0 + 1.5 * np.sign(v))
    found = [item.function_of for item in dependences(*split_of(rest, np.random.default_rng(0)), drive)]
    assert found.index("position") < found.index("position_by_direction")


def test_of_what_the_force_does_not_show_it_says_nothing() -> None:
    """The motor reads 3 um more in the middle of the way, without any force."""
    drive = read(Nominal, load_toml(tiers.AXIS), "axis.toml").drive
    split, simulated = split_of(np.zeros(len(STROKES)), np.random.default_rng(0))
    bump = np.where((STROKES[:, 0] > 0.06) & (STROKES[:, 0] < 0.08), 3e-6, 0.0)
    moved = [{**own, "position_m": own["position_m"] + bump} for own in simulated]
    (best, *_) = dependences(split, moved, drive)
    assert best.function_of.startswith("position")
    assert best.most is None


def test_where_the_rest_is_largest_is_said_in_the_units_of_the_motion() -> None:
    drive = read(Nominal, load_toml(tiers.AXIS), "axis.toml").drive
    bump = np.where((STROKES[:, 0] > 0.06) & (STROKES[:, 0] < 0.08), -8.0, 0.0)
    best = dependences(*split_of(bump, np.random.default_rng(0)), drive)[0]
    most = best.most
    assert most is not None
    assert most.unit == "m"
    assert 0.05 < most.low < 0.065
    assert 0.075 < most.high < 0.09
    assert -8.0 <= most.force_N < -6.0


def test_noise_is_a_function_of_nothing() -> None:
    drive = read(Nominal, load_toml(tiers.AXIS), "axis.toml").drive
    split, simulated = split_of(np.zeros(len(STROKES)), np.random.default_rng(1))
    assert dependences(split, simulated, drive) == ()
