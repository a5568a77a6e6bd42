"""A velocity loop alone, by a tachometer or by differences of its encoder."""

import dataclasses

import axis_lab
import numpy as np
import pytest

from fdbench.errors import SpecError
from fdbench.plants.feed_drive import Cascade, VelocityLoop


@pytest.mark.parametrize("span", [0, 1, 2])
def test_it_is_a_cascade_without_its_position_loop_and_integral(span: int) -> None:
    motion, duration_s = axis_lab.protocol(1.0)["fast"]
    loop = VelocityLoop(gain_N_s_per_m=2e4, force_limit_N=6000.0, difference_span=span)
    same = axis_lab.drive().controller
    assert isinstance(same, Cascade)
    cascade = dataclasses.replace(same, position_gain_per_s=0.0, integral_gain_N_per_m=0.0, difference_span=span)
    found = [
        axis_lab.record(dataclasses.replace(axis_lab.drive(), controller=controller), (), motion, duration_s, seed=1)
        for controller in (loop, cascade)
    ]
    np.testing.assert_allclose(found[0]["motor_position_m"], found[1]["motor_position_m"], rtol=1e-9, atol=1e-12)


def test_it_has_no_longer_difference() -> None:
    with pytest.raises(SpecError, match="difference_span"):
        VelocityLoop(gain_N_s_per_m=2e4, force_limit_N=6000.0, difference_span=3)
