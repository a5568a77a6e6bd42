"""Numbers, units, probabilities and intervals as people read them, on the terminal and on pages alike."""

import math
import re
from collections.abc import Sequence

from fdbench.errors import brief, printable
from fdbench.rotary import spoken_name, spoken_unit
from fdbench.units import UNITS, split_unit

SURE = 0.99  # no probability is printed beyond it
PREFIXES = {6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
# Smallest and largest prefix that is in use: nobody writes km/s, krad or ks.
IN_USE = {
    **dict.fromkeys(("m", "s", "rad", "m/s", "m/s^2", "m/s^3", "rad/s", "rad/s^2"), (-12, 0)),
    **dict.fromkeys(("N", "A", "V", "W", "N m", "N/s"), (-12, 3)),
    "Pa": (-12, 6),
}
TENTHS = {"N", "A", "V", "W", "N m", "N/s"}  # written without prefix from 0.1 on: 0.4 N, but 400 mm

_ABSOLUTE_FOLDER = re.compile(r"(?<![\w:/.>~])(?:[A-Za-z]:)?[/\\](?:[^\s/\\:']+[/\\])+")
_ADDRESS = re.compile(r"0x[0-9a-fA-F]+")


def probability_text(probability: float) -> str:
    """Return a probability without false certainty.

    >>> probability_text(0.99999), probability_text(0.57), probability_text(0.001)
    ('above 0.99', '0.57', 'below 0.01')
    """
    if probability > SURE:
        return f"above {SURE}"
    return f"{probability:.2f}" if probability >= 1.0 - SURE else f"below {1.0 - SURE:.2f}"


def percent(share: float) -> str:
    """Return a share in per cent; only a whole is 100 %.

    >>> percent(0.447), percent(0.004), percent(0.0), percent(-1e-16), percent(0.9999)
    ('45 %', '0.4 %', '0 %', '0 %', 'above 99 %')
    """
    if 0.995 <= share < 1.0:
        return "above 99 %"
    return f"{100.0 * share:.1g} %" if 5e-6 <= abs(share) < 0.01 else f"{round(100.0 * share)} %"


def less(reduction: float, ci95: Sequence[float] | None = None) -> str:
    """Return a reduction in words, with its interval where there is one.

    >>> less(0.25), less(-0.25)
    ('25 % less', '25 % more')
    >>> less(0.25, (0.2, 0.3)), less(-1.25, (-1.5, 0.1))
    ('25 % less (95 %: 20 to 30 %)', '125 % more (95 %: -10 to 150 %)')
    """
    if reduction >= 0.0:
        return f"{percent(reduction)} less{'' if ci95 is None else f' ({share_interval_text(ci95)})'}"
    interval = "" if ci95 is None else f" (95 %: {round(-100.0 * ci95[1])} to {round(-100.0 * ci95[0])} %)"
    return f"{percent(-reduction)} more{interval}"


def share_interval_text(bounds: Sequence[float]) -> str:
    """Return a 95 % interval of a share.

    >>> share_interval_text([0.331, 0.529]), share_interval_text([0.97, 0.9999]), share_interval_text([0.9997, 0.9999])
    ('95 %: 33 to 53 %', '95 %: 97 to 99 %', '95 %: above 99 %')
    """
    low, high = bounds
    if low >= 0.995:
        return "95 %: above 99 %"
    return f"95 %: {100.0 * low:.0f} to {100.0 * (min(high, 0.99) if high < 1.0 else high):.0f} %"


def number(value: float) -> str:
    """Return a number with three digits and no exponent where that is short.

    >>> number(8184.0), number(55.02)
    ('8184', '55')
    """
    return f"{value:.0f}" if 1000.0 <= abs(value) < 1e6 else f"{value:.3g}"


def unit_text(unit: str) -> str:
    """Return a unit as it is printed.

    >>> unit_text("N s^2/m^2"), unit_text("us")
    ('N s²/m²', 'µs')
    """
    unit = spoken_unit(unit)
    return unit.replace("^2", "²").replace("^3", "³") if unit != "us" else "µs"


def scaled(unit: str, peak: float) -> tuple[float, str]:
    """Return the factor and the unit in which values up to ``peak`` are written.

    They have one to three digits before the point, where the prefix that this takes is in use.

    >>> scaled("m/s", 4e-5), scaled("N s/m", 4e-5), scaled("m", 0.9996)
    ((1000000.0, 'µm/s'), (1.0, 'N s/m'), (1.0, 'm'))
    >>> scaled("N", 0.4), scaled("N", 0.04), scaled("N", 4e3), scaled("m/s^2", 4e3)
    ((1.0, 'N'), (1000.0, 'mN'), (0.001, 'kN'), (1.0, 'm/s²'))
    """
    unit = spoken_unit(unit)
    if unit not in IN_USE or not 0.0 < peak < math.inf or (unit in TENTHS and 0.1 <= peak < 1.0):
        return 1.0, unit_text(unit)
    lowest, highest = IN_USE[unit]
    exponent = min(max(3 * math.floor(math.log10(1.0005 * peak) / 3.0), lowest), highest)
    return 10.0**-exponent, PREFIXES[exponent] + unit_text(unit)


def si_text(value: float, unit: str) -> str:
    """Return a value with three digits and its unit.

    >>> si_text(0.0024942, "m"), si_text(-36.4858, "N s/m")
    ('2.49 mm', '-36.5 N s/m')
    """
    factor, prefixed = scaled(unit, abs(value))
    return f"{factor * value:.3g} {prefixed}".rstrip()


def quantity(name: str) -> tuple[str, str]:
    """Return what a column or parameter is called and its unit.

    >>> quantity("motor_force_N"), quantity("beta_1")
    (('motor force', 'N'), ('beta_1', ''))
    """
    stem, suffix = split_unit(spoken_name(name))
    return (stem.replace("_", " "), UNITS[suffix]) if suffix else (name, "")


def markdown_text(text: str) -> str:
    r"""Return a text that others wrote, in which nothing is markup of Markdown or HTML.

    >>> markdown_text("<b>[x](y)`")
    '\\<b\\>\\[x\\](y)\\`'
    """
    return re.sub(r"([\\`<>\[\]*&])", r"\\\1", brief(printable(text)))


def public_text(message: str) -> str:
    """Return a message without the folders and addresses of one machine.

    >>> public_text("/data/emps/DATA_EMPS.mat: not on this machine. See https://example.org/a/b.html")
    'DATA_EMPS.mat: not on this machine. See https://example.org/a/b.html'
    """
    return _ADDRESS.sub("0x…", _ABSOLUTE_FOLDER.sub("", message))
