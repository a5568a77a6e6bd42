"""A force offset that no model has in doubt is one in proportion to the forces of the axis, whatever its size."""

import axis_lab
import pytest

from fdbench.diagnosis.model.nominal import Covered, Nominal, Simulation, Uncertainty
from fdbench.diagnosis.settings import MODEL


def doubt_N(force_N: float, **uncertainty: float) -> float:
    nominal = Nominal(
        plant=axis_lab.drive(), simulation=Simulation(substeps=10), uncertainty=Uncertainty(**uncertainty)
    )
    return nominal.beside(Covered(fastest_m_per_s=0.3, longest_s=5.0, force_N=force_N, period_s=1e-3)).force_offset_N


@pytest.mark.parametrize("part", [0.01, 0.2, 1.0, 10.0])
def test_it_is_in_proportion_to_the_forces(part: float) -> None:
    assert doubt_N(part * MODEL.usual_force_N) == pytest.approx(part * MODEL.usual_force_offset_N)


def test_what_a_model_says_of_it_holds() -> None:
    assert doubt_N(20.0, force_offset_N=3.0) == 3.0
    assert doubt_N(0.0) == MODEL.usual_force_offset_N, "no force is known"
