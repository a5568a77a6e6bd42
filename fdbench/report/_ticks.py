"""Where an axis has its ticks, and what stands beside them."""

import math
from collections.abc import Sequence

MOST_LABELS = 6  # of a logarithmic axis
STEPS = {1.0: 1.5, 2.0: 3.5, 5.0: 7.5, 10.0: math.inf}  # and up to which rough one each is taken


def linear_ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Return round numbers between two bounds, at steps of 1, 2 or 5 times a power of ten.

    >>> linear_ticks(0.0, 10.0), linear_ticks(-0.3, 0.45, 3)
    ([0.0, 2.0, 4.0, 6.0, 8.0, 10.0], [-0.2, 0.0, 0.2, 0.4])
    """
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(factor for factor, end in STEPS.items() if rough < end * power)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [float(f"{number * step:.12g}") for number in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Return powers of ten between two positive bounds; 2 and 5 times them too where there are few.

    >>> log_ticks(0.4, 3000.0), log_ticks(3.0, 60.0)
    ([1.0, 10.0, 100.0, 1000.0], [5.0, 10.0, 20.0, 50.0])
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for factors in ((1.0, 2.0, 5.0), (1.0,)):
        found = [float(f"{factor}e{power}") for power in range(first, last + 1) for factor in factors]
        inside = [tick for tick in found if 0.999 * low <= tick <= 1.001 * high]
        if len(inside) <= MOST_LABELS:
            return inside
    return inside[:: -(-len(inside) // MOST_LABELS)]


def tick_texts(ticks: Sequence[float]) -> list[str]:
    """Return ticks as text, equally many digits behind the point where they are equally far apart.

    >>> tick_texts([0.0, 0.5, 1.0]), tick_texts([1.0, 10.0, 100.0]), tick_texts([0.01, 1.0, 1e6]), tick_texts([-20.0])
    (['0', '0.5', '1'], ['1', '10', '100'], ['0.01', '1', '10⁶'], ['−20'])
    """
    return [_text(tick) for tick in ticks]


def _text(tick: float) -> str:
    size = abs(tick)
    if size and not 1e-3 <= size < 1e5:
        mantissa, exponent = f"{size:.2e}".split("e")
        short = f"{float(mantissa):g}"
        power = "10" + "".join("⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".index(sign)] for sign in str(int(exponent)))
        words = power if short == "1" else f"{short}·{power}"
    else:
        words = f"{size:.10g}"
    return f"−{words}" if tick < 0.0 else words
