"""Where the gap is thousands of times the noise, what is there is named, and nothing besides."""

import axis_lab
import pytest

from fdbench.diagnosis.diagnose import diagnose
from fdbench.effects import effects
from fdbench.trials.score import NAMED


@pytest.mark.parametrize("name", ["backlash", "lead_error", "structural_mode"])
@pytest.mark.parametrize("noise_m", [3e-9, 0.0])
def test_what_is_there_is_named_alone(name: str, noise_m: float) -> None:
    extra = (effects.get(name).typical(),)
    answer = diagnose(*axis_lab.case(extra, seed=3, noise_m=noise_m)).answer
    named = [effect for effect, chance in answer.chances().items() if chance > NAMED]
    assert named == [name]
    assert answer.unknown_probability < NAMED
    assert answer.no_gap_probability < NAMED
