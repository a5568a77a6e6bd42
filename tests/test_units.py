import re

import pytest
from scipy import constants

from fdbench.errors import SpecError
from fdbench.units import FOREIGN, UNITS, factor_to_si, si_unit, split_unit, unit_of


@pytest.mark.parametrize("suffix", sorted(set(UNITS) - {"percent"}))
def test_printed_unit_follows_from_the_suffix(suffix: str) -> None:
    above, _, below = suffix.partition("per_") if suffix.startswith("per_") else suffix.partition("_per_")
    powers = re.sub(r"([a-z])(\d)", r"\1^\2", re.sub(r"N2", "N^2", f"{above or '1'}/{below}".rstrip("/")))
    assert powers.replace("Nm", "N m").replace("_", " ") == UNITS[suffix]
    assert unit_of(f"quantity_{suffix}") == UNITS[suffix]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("mass_kg", ("mass", "kg")),
        ("velocity_m_per_s", ("velocity", "m_per_s")),
        ("forgetting_per_s", ("forgetting", "per_s")),
        ("beta_1", ("beta_1", "")),
        ("velocity_mm_per_s", ("velocity_mm_per_s", "")),
        ("stiffness_kN_per_m", ("stiffness_kN_per_m", "")),
        ("speed_rev_per_s", ("speed_rev_per_s", "")),
        ("position_mm", ("position_mm", "")),
        ("m", ("", "m")),
    ],
)
def test_a_foreign_unit_is_not_taken_for_si(name: str, expected: tuple[str, str]) -> None:
    assert split_unit(name) == expected


@pytest.mark.parametrize(
    ("unit", "name", "factor"),
    [
        ("in", "lead_m", constants.inch),
        ("in/min", "feedrate_m_per_s", constants.inch / constants.minute),
        ("mm/min", "feedrate_m_per_s", constants.milli / constants.minute),
        ("deg", "angle_rad", constants.degree),
        ("rpm", "speed_rad_per_s", 2.0 * constants.pi / constants.minute),
        ("rev/s", "speed_rad_per_s", 2.0 * constants.pi),
        ("deg/s^2", "acceleration_rad_per_s2", constants.degree),
        ("rev/s2", "acceleration_rad_per_s2", 2.0 * constants.pi),
        ("lbf", "force_N", constants.lbf),
        ("bar", "pressure_Pa", constants.bar),
        ("us", "time_s", constants.micro),
        ("us", "delay_us", 1.0),
        ("m/s", "velocity_m_per_s", 1.0),
        ("m_per_s", "velocity_m_per_s", 1.0),
        ("", "beta_1", 1.0),
    ],
)
def test_factors(unit: str, name: str, factor: float) -> None:
    assert factor_to_si(unit, name, "test") == pytest.approx(factor, rel=1e-15)


def test_every_foreign_unit_leads_to_a_unit_of_the_list() -> None:
    assert {si for si, _ in FOREIGN.values()} <= set(UNITS.values())
    assert all(factor > 0.0 for _, factor in FOREIGN.values())
    assert si_unit("mV", "test") == ("V", 1e-3)


@pytest.mark.parametrize(
    ("unit", "name", "words"),
    [
        ("mm", "force_N", ["'mm' is a unit of m", "force_N is in N"]),
        ("mm", "beta_1", ["pure numbers"]),
        ("milimeter/s", "velocity_m_per_s", ["unknown unit 'milimeter/s'"]),
        ("kNN", "force_N", ["Did you mean kN"]),
        ("degC", "temperature_K", ["offset = 273.15"]),
    ],
)
def test_wrong_units(unit: str, name: str, words: list[str]) -> None:
    with pytest.raises(SpecError) as caught:
        factor_to_si(unit, name, "axis.toml")
    assert all(word in str(caught.value) for word in ["axis.toml", *words])
