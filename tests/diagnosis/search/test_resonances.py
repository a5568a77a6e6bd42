"""Resonances are located by what the measured motion would make of a mass on a spring."""

from types import SimpleNamespace
from typing import Any

import axis_lab
import numpy as np
import pytest

from fdbench.diagnosis.experiment.trajectory import moves
from fdbench.diagnosis.records.noise_model import white
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.diagnosis.search.resonances import SPACING, resonances
from fdbench.effects import effects
from fdbench.record import FloatArray

PERIOD_S = 1e-3
STROKES = moves((0.0, 0.2, 0.0, 0.05, 0.0), (0.3,), 4.0, PERIOD_S)
DRIVE = axis_lab.drive()
NOISE = {"motor_force_N": white(2.0, measured=True), "position_m": white(1e-9, measured=True)}
MODE = effects.get("structural_mode")


def split() -> Any:
    run = RecordedRun(name="x", period_s=PERIOD_S, reference=STROKES, channels={"position_m": STROKES[:, 0]}, lap=None)
    return SimpleNamespace(runs=[run, run], noise_models=NOISE)


def carried(frequency_Hz: float, damping: float) -> FloatArray:
    """Return the force of a mode along the strokes, sample by sample as the simulator advances it."""
    mode = MODE.typical(natural_frequency_Hz=frequency_Hz, damping_ratio=damping).values()
    speed, states, found = np.diff(STROKES[:, 0]) / PERIOD_S, (0.0, 0.0), []
    for v in speed.tolist():
        force, _, *states = MODE.kernel.py_func(0.0, PERIOD_S, 0.0, v, 0.0, *mode, *states)
        found.append(force)
    return np.array(found)[1:-1]


@pytest.mark.parametrize("frequency_Hz", [7.0, 16.4, 52.0, 150.0])
@pytest.mark.parametrize("damping", [0.015, 0.06])
def test_a_mode_is_found_between_any_two_frequencies(frequency_Hz: float, damping: float) -> None:
    """Beside noise, a mass and a damping that are wrong."""
    rng, speed = np.random.default_rng(4), np.gradient(STROKES[:, 0], PERIOD_S)
    wrong = (3.0 * np.gradient(speed, PERIOD_S) + 40.0 * speed)[1:-2]
    lacking = [carried(frequency_Hz, damping) + wrong + 0.5 * rng.standard_normal(len(wrong)) for _ in range(2)]
    first, *_ = resonances(lacking, split(), DRIVE)
    assert abs(np.log(first / frequency_Hz)) < 1.6 * np.log(SPACING)


def test_what_pulls_the_other_way_and_no_motion_have_none() -> None:
    force = carried(30.0, 0.03)
    assert all(abs(found / 30.0 - 1.0) > 0.05 for found in resonances([-force, -force], split(), DRIVE))
    still = np.zeros(len(force))
    assert resonances([still, still], split(), DRIVE) == []
    lost = np.full(len(force), np.nan)
    assert resonances([lost, lost], split(), DRIVE) == []
