"""McPherson (2024): every figure that must hold, with the scenarios and estimators as shipped."""

from fdbench import reproduce
from fdbench.reproduce import mcpherson


def test_every_figure_holds() -> None:
    rows = reproduce.run("mcpherson")
    assert len(rows) >= 30
    assert [f"{row.item}: {row.value:.5g}, not {row.target:.5g}" for row in rows if not row.ok] == []


def test_figures_can_fail() -> None:
    control = mcpherson.load_scenario("ShakerControl-v0")
    biased = mcpherson.with_amplitude(mcpherson.load_scenario("ShakerConstant-v0"), 0.3)
    shift = mcpherson.mean_beta(biased, "least_squares", 1) - mcpherson.mean_beta(control, "least_squares", 1)
    assert shift[0] < -0.04
