"""The spectrum of the prediction error against the noise floor, as the metrics of the output track have it."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.metrics import Outcome
from fdbench.metrics._series import no_white_floor
from fdbench.metrics._spectrum import (
    FEWEST_ROWS,
    ORDERS,
    folded,
    n_rows_in_window,
    no_density,
    residual_density,
    segment_length,
)
from fdbench.regression import FloatArray
from fdbench.report._figures import INK, LINE_PX, Curve, Figure, Panel, Style, styles_of
from fdbench.report._page import Block, note
from fdbench.report._series import gaps, thinned
from fdbench.scenario import Scenario
from fdbench.wording import unit_text

# Share of an axis that the label of a line takes.
ROOM_FOR_A_LABEL = 0.02


def spectrum(
    scenario: Scenario, outcomes: Mapping[str, Outcome], unit: str, hidden: Sequence[str], n_points: int
) -> Iterator[Block]:
    """Yield the density of the prediction error within the scenario's window, or why there is none.

    Parameters
    ----------
    outcomes : mapping
        By estimator; those that claim an output.
    unit : str
        Of the output.
    hidden : sequence of str
        Estimators that are drawn only when their name is clicked.
    n_points : int
        Of a curve.
    """
    if not outcomes:
        return
    first = next(iter(outcomes.values()))
    if n_rows_in_window(first) < FEWEST_ROWS:
        yield note(f"Fewer than {FEWEST_ROWS} rows in the window: no spectrum.")
    elif len(gaps(first.regression.time_s)):
        yield note("The rows are not one series without gaps: no spectrum.")
    else:
        yield _figure(scenario, outcomes, unit, hidden, n_points)


def _figure(
    scenario: Scenario, outcomes: Mapping[str, Outcome], unit: str, hidden: Sequence[str], n_points: int
) -> Figure:
    first = next(iter(outcomes.values()))
    rate_Hz, length = 1.0 / first.regression.sampling_time_s, segment_length(n_rows_in_window(first))
    frequency_Hz = rate_Hz / length * np.arange(length // 2 + 1, dtype=np.float64)
    # Each segment is without its mean, so the bin at 0 Hz holds nothing.
    items, styles = [], styles_of(list(outcomes))
    for name, outcome in sorted(outcomes.items(), key=lambda item: item[0] != ORACLE):
        x, y = thinned(frequency_Hz[1:], _decibels(residual_density(outcome)[1:]), n_points)
        style = styles[name]
        items.append(Curve(name=name, x=x, y=y, style=style, width=LINE_PX * style.breadth, hidden=name in hidden))
    captions = [f"Welch's method: Hann's window, segments of {length} rows, {_span(scenario)}."]
    reason = no_white_floor(first)
    if reason is None:
        floor = _decibels(np.full(2, 2.0 * first.scenario.reality.noise.equation_velocity_m_per_s**2 / rate_Hz))
        dashed = Style(colour=INK, dash="dash")
        items.append(Curve(name="noise floor", x=frequency_Hz[[1, -1]], y=floor, style=dashed))
        captions.append("Dashed: density of the noise alone; what is below has fitted the noise as well.")
    else:
        instead = "" if no_density(first) else "; the metrics take what the truth leaves, the oracle's curve, for it"
        captions.append(f"No white noise floor: {reason}{instead}.")
    marks: list[tuple[float, str]] = []
    period_s = scenario.estimation.disturbance_period_s
    if period_s is not None:
        marks = _marks(1.0 / period_s, rate_Hz)
        captions.append(
            f"Dotted: frequency of the disturbance, f = {1.0 / period_s:.5g} Hz, and its harmonics, folded at "
            f"{0.5 * rate_Hz:.5g} Hz."
        )
    power = unit_text(f"({unit})^2" if "/" in unit or " " in unit else f"{unit}^2")
    panel = Panel(y_title=f"power density (dB re 1 {power}/Hz)", items=items, height_px=320)
    return Figure(
        title="Spectrum of the prediction error",
        panels=[panel],
        x_title="frequency (Hz)",
        caption=" ".join(captions),
        marks=marks,
    )


def _decibels(density: FloatArray) -> FloatArray:
    """Return 10 lg of a density; none at all is a gap."""
    return np.asarray(10.0 * np.log10(np.where(density > 0.0, density, np.nan)))


def _span(scenario: Scenario) -> str:
    window_s = scenario.estimation.window_s
    return "all rows" if window_s is None else f"rows from {window_s[0]:g} s to {window_s[1]:g} s"


def _marks(frequency_Hz: float, rate_Hz: float) -> list[tuple[float, str]]:
    """Return a frequency and its harmonics, folded, with their names; no name stands on another."""
    marks: list[tuple[float, str]] = []
    for order in (1, *ORDERS):
        x = folded(order * frequency_Hz, rate_Hz)
        is_free = all(abs(x - other) > ROOM_FOR_A_LABEL * 0.5 * rate_Hz for other, text in marks if text)
        marks.append((x, ("f" if order == 1 else f"{order}f") if is_free else ""))
    return marks
