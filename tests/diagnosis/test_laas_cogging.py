"""A measured rotary servo with strong cogging of order 72, from the user's copy of the data; no controller is given."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import shared_file
from rotary_servo import SERVO

from fdbench import diagnose

PERIOD_S = 1e-3
MODEL = f"""{SERVO}
[uncertainty]
mass = 0.1
viscous = 0.5
known_effects = 0.5
"""


def test_the_documented_cogging_is_named_first(tmp_path: Path) -> None:
    time, angle, _, _, current, compensated = np.loadtxt(
        shared_file("data", "laas_cogging", "speed_test1.txt"), delimiter=",", skiprows=1
    ).T
    assert not compensated[time < 15.0].any()

    def part(start_s: float, end_s: float) -> pd.DataFrame:
        own = np.arange(start_s, end_s, PERIOD_S)
        columns = {"position_rad": angle, "motor_torque_Nm": current}
        return pd.DataFrame({"time_s": own - own[0], **{k: np.interp(own, time, v) for k, v in columns.items()}})

    model = tmp_path / "servo.toml"
    model.write_text(MODEL)
    answer = diagnose(model, [part(1.0, 6.0), part(6.0, 11.0)], part(11.0, 15.0)).answer
    first = answer.causes[0]
    assert first.effect == "cogging"
    assert first.probability > 0.6
    assert 2.0 * math.pi / first.parameters["pitch_m"].value == pytest.approx(72.0, abs=0.1)
    # One sine of order 72 removes 54 % at best of what inverse dynamics leaves of this part; 80 % of that is asked for.
    assert answer.gap.channels["motor_force_N"].reduction > 0.8 * 0.54
