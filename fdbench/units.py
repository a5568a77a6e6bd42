"""The closed list of unit suffixes: a name carries its SI unit, and ``per`` divides.

>>> unit_of("viscous_friction_N_s_per_m")
'N s/m'
>>> unit_of("beta_1"), unit_of("velocity_mm_per_s")
('', '')
>>> factor_to_si("mm/min", "feedrate_m_per_s", "example")
1.6666666666666667e-05
"""

import functools
import re

from fdbench.errors import SpecError, did_you_mean

# Largest first: a time is written in the first one that it is not smaller than.
TIMES: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
DIGITS_OF_A_TIME = 3

UNITS: dict[str, str] = {
    "s": "s",
    "m": "m",
    "kg": "kg",
    "N": "N",
    "Nm": "N m",
    "A": "A",
    "V": "V",
    "K": "K",
    "W": "W",
    "Hz": "Hz",
    "Hz_per_s": "Hz/s",
    "Pa": "Pa",
    "rad": "rad",
    "dB": "dB",
    "us": "us",
    "percent": "%",
    "m_per_s": "m/s",
    "m_per_s2": "m/s^2",
    "m_per_s3": "m/s^3",
    "rad_per_s": "rad/s",
    "rad_per_s2": "rad/s^2",
    "N_per_m": "N/m",
    "N_per_m2": "N/m^2",
    "N_per_s": "N/s",
    "N_per_V": "N/V",
    "N_per_A": "N/A",
    "N_per_K": "N/K",
    "Nm_per_A": "N m/A",
    "Nm_per_rad": "N m/rad",
    "Nm_per_rad2": "N m/rad^2",
    "Nm_s_per_rad": "N m s/rad",
    "Nm_s2_per_rad2": "N m s^2/rad^2",
    "rad_per_s3": "rad/s^3",
    "per_Nm": "1/N m",
    "V_s_per_m": "V s/m",
    "N_s_per_m": "N s/m",
    "N_s2_per_m2": "N s^2/m^2",
    "kg_m2": "kg m^2",
    "m_per_rad": "m/rad",
    "m_per_N": "m/N",
    "m_per_K": "m/K",
    "per_s": "1/s",
    "per_s2": "1/s^2",
    "per_m": "1/m",
    "per_K": "1/K",
    "per_N": "1/N",
    "per_kg": "1/kg",
    "m2": "m^2",
    "N2": "N^2",
}

_LONGEST_FIRST = sorted(UNITS, key=len, reverse=True)

# Factors to SI for the foreign units that a mapping file may name.
FOREIGN: dict[str, tuple[str, float]] = {
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "nm": ("m", 1e-9),
    "in": ("m", 0.0254),
    "mm/s": ("m/s", 1e-3),
    "um/s": ("m/s", 1e-6),
    "mm/min": ("m/s", 1e-3 / 60.0),
    "m/min": ("m/s", 1.0 / 60.0),
    "in/min": ("m/s", 0.0254 / 60.0),
    "m/s2": ("m/s^2", 1.0),
    "mm/s^2": ("m/s^2", 1e-3),
    "mm/s2": ("m/s^2", 1e-3),
    "h": ("s", 3600.0),
    "min": ("s", 60.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "kHz": ("Hz", 1e3),
    "uN": ("N", 1e-6),
    "mN": ("N", 1e-3),
    "kN": ("N", 1e3),
    "lbf": ("N", 4.4482216152605),
    "uA": ("A", 1e-6),
    "mA": ("A", 1e-3),
    "kA": ("A", 1e3),
    "uV": ("V", 1e-6),
    "mV": ("V", 1e-3),
    "kV": ("V", 1e3),
    "kW": ("W", 1e3),
    "bar": ("Pa", 1e5),
    "MPa": ("Pa", 1e6),
    "Nmm": ("N m", 1e-3),
    "Ncm": ("N m", 1e-2),
    "uNm": ("N m", 1e-6),
    "uN m": ("N m", 1e-6),
    "mNm": ("N m", 1e-3),
    "mN m": ("N m", 1e-3),
    "kNm": ("N m", 1e3),
    "kN m": ("N m", 1e3),
    "urad": ("rad", 1e-6),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", 0.017453292519943295),
    "rev": ("rad", 6.283185307179586),
    "deg/s": ("rad/s", 0.017453292519943295),
    "rev/s": ("rad/s", 6.283185307179586),
    "mrad/s": ("rad/s", 1e-3),
    "rad/s2": ("rad/s^2", 1.0),
    "deg/s^2": ("rad/s^2", 0.017453292519943295),
    "deg/s2": ("rad/s^2", 0.017453292519943295),
    "rev/s^2": ("rad/s^2", 6.283185307179586),
    "rev/s2": ("rad/s^2", 6.283185307179586),
    "rpm": ("rad/s", 0.10471975511965977),
    "1/min": ("rad/s", 0.10471975511965977),
}

_OF_A_SCREW = " The angle of a ball screw: add gain = lead_m / 6.2832."
_OF_A_ROTARY_AXIS = (
    " A rotary axis: name the columns position_rad, reference_position_rad, motor_torque_Nm and so on (deg, rev and "
    'rpm are converted), and write axis = "rotary" in the model.'
)
# What to do where a mapping gives a rotary unit for a linear column.
_ROTARY = {
    ("rad", "m"): _OF_A_SCREW + _OF_A_ROTARY_AXIS,
    ("rad/s", "m/s"): _OF_A_SCREW + _OF_A_ROTARY_AXIS,
    ("N m", "N"): " Name the column motor_torque_Nm where the model has a rotary_motor." + _OF_A_ROTARY_AXIS,
}

# How a unit is written elsewhere, and how it is here.
_SPELLINGS = (
    (r"[µμ]", "u"),
    ("°|degrees?|Grad", "deg"),
    (r"\bsec(onds?)?\b", "s"),
    ("²|\\*\\*2", "^2"),
    (r"[uU]/min|rev/min|turns?/min", "1/min"),
    (r"\bturns?\b|\bU\b", "rev"),
    (r"\s*[·*⋅]\s*", " "),
    (r"\bNewtons?\b", "N"),
)
_CASES = {"nm": "N m", "n m": "N m", "nmm": "Nmm", "n mm": "Nmm", "rpm": "rpm", "min-1": "1/min", "inch": "in"}
_CASES |= dict.fromkeys(("amp", "ampere"), "A")

# A name such as velocity_mm_per_s must not pass for a quantity per second.
_UNIT_WORDS = {word for unit in [*UNITS, *FOREIGN] for word in unit.replace("/", "_").split("_")} - {"per", "1"}


def time_text(time: float, unit: str = "s") -> str:
    """Return a time, given in ``unit``, with at most three digits in the unit that suits it.

    >>> time_text(17.32), time_text(4.2e-3), time_text(85e-6), time_text(0.9999e-3), time_text(17300.0, "us")
    ('17.3 s', '4.2 ms', '85 us', '1 ms', '17.3 ms')
    """
    rounded_s = float(f"{TIMES[unit] * time:.{DIGITS_OF_A_TIME}g}")
    if rounded_s == 0.0:
        return "0 s"
    suited = next((name for name, size in TIMES.items() if abs(rounded_s) >= size), "ns")
    return f"{float(f'{rounded_s / TIMES[suited]:.{DIGITS_OF_A_TIME}g}'):g} {suited}"


@functools.lru_cache(maxsize=4096)
def split_unit(name: str) -> tuple[str, str]:
    """Return what ``name`` is called and its unit suffix, an empty one for a pure number.

    >>> split_unit("motor_force_N"), split_unit("damping_ratio")
    (('motor_force', 'N'), ('damping_ratio', ''))
    """
    for suffix in _LONGEST_FIRST:
        if name == suffix:
            return "", suffix
        if name.endswith("_" + suffix):
            stem = name[: -len(suffix) - 1]
            foreign = suffix.startswith("per_") and stem.rsplit("_", 1)[-1] in _UNIT_WORDS
            return (name, "") if foreign else (stem, suffix)
    return name, ""


def unit_of(name: str) -> str:
    """Return the unit that the suffix of ``name`` states, or an empty string for a pure number."""
    return UNITS.get(split_unit(name)[1], "")


def si_unit(unit: str, where: str) -> tuple[str, float]:
    """Return the SI unit of the quantity that ``unit`` measures, and the factor to it.

    >>> si_unit("mA", "example")
    ('A', 0.001)

    Raises
    ------
    SpecError
        If the unit is unknown.
    """
    if unit in UNITS.values():
        return FOREIGN.get(unit, (unit, 1.0))
    if unit in UNITS:
        return UNITS[unit], 1.0
    if unit not in FOREIGN:
        hint = " A temperature in degrees Celsius: unit = 'K' with offset = 273.15."
        celsius = unit.lstrip("°").lower() in {"c", "degc", "celsius"}
        raise SpecError(f"{where}: unknown unit '{unit}'.{hint if celsius else _nearest_unit(unit)}")
    return FOREIGN[unit]


def spelt_unit(text: str) -> str:
    """Return our name of a unit as people and controllers write it, or an empty text where it is none of ours.

    >>> spelt_unit("[mm/sec]"), spelt_unit("°"), spelt_unit("N·m"), spelt_unit("U/min"), spelt_unit("furlong")
    ('mm/s', 'deg', 'N m', '1/min', '')
    """
    plain = text.strip().strip("[](){}<>").strip()
    if plain in UNITS.values() or plain in FOREIGN:
        return plain
    for written, ours in _SPELLINGS:
        plain = re.sub(written, ours, plain)
    plain = _CASES.get(plain.lower(), plain)
    plain = plain if plain in UNITS.values() or plain in FOREIGN else plain.lower()
    return plain if plain in UNITS.values() or plain in FOREIGN else ""


def factor_to_si(unit: str, name: str, where: str) -> float:
    """Return the factor that turns ``unit`` into the unit stated by the suffix of ``name``.

    Raises
    ------
    SpecError
        If the unit is unknown or measures something else than ``name`` does.
    """
    target = unit_of(name)
    if unit == target:
        return 1.0
    si, factor = si_unit(unit, where)
    if si != target:
        advice = _ROTARY.get((si, target), "")
        raise SpecError(f"{where}: '{unit}' is a unit of {si}, but {name} is in {target or 'pure numbers'}.{advice}")
    return factor


def _nearest_unit(unit: str) -> str:
    return did_you_mean(unit, [*UNITS.values(), *FOREIGN])
