"""The page of a linear model: modes, margins, Bode and Nyquist diagrams, step, measured responses beside it."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fdbench.plants import LinearSystem
from fdbench.record import FloatArray
from fdbench.report._figures import Panel, Style, axis, encoded, labelled, layout, line, plain, stack
from fdbench.report._measured_response import MeasuredResponse
from fdbench.report._page import Block, Figure, Grid, Section, Trace, note, paragraph, table, write_page
from fdbench.units import UNITS, split_unit
from fdbench.wording import quantity

POINTS, LOWEST = 600, 1e-3  # drawn of a response, and its lowest frequency in halves of the sampling rate
DRAWN_STEP = 1500
FAR = 3.0  # of the Nyquist diagram

ComplexArray = NDArray[np.complex128]


def write_linear(
    name: str,
    system: LinearSystem,
    tables: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]],
    measured: Sequence[MeasuredResponse],
    output: Path,
) -> None:
    """Write the page of a linear system.

    Parameters
    ----------
    name : str
        Of the scenario or model.
    system : LinearSystem
    tables : sequence of (title, header, rows)
        As the terminal shows them.
    measured : sequence of MeasuredResponse
        Drawn beside the tracking, or beside the plant where it has no controller.
    output : path

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    at_Hz = np.geomspace(LOWEST, 1.0, POINTS) * 0.5 / system.sampling_time_s
    sections = [Section(title, [table(head, rows, "l" + "r" * (len(head) - 1))]) for title, head, rows in tables]
    sections += [
        Section("Tracking", list(_tracking(system, at_Hz, measured))),
        Section("Open loops", list(_loops(system, at_Hz))),
        Section("Step", list(_steps(system))),
        Section("Plant", list(_plant(system, at_Hz, measured if system.closed is None else ()))),
    ]
    lead = [
        paragraph(
            f"Nominal linear model of {name}, one sample each {1e3 * system.sampling_time_s:.4g} ms, with dead times, "
            "sampling and controller. Of friction it has the slope at speed; force limits are left out."
        )
    ]
    write_page(output, f"fdbench: linear model of {name}", lead, [part for part in sections if part.blocks])


def _style(number: int, dash: str = "solid") -> Style:
    return Style(colour=f"var(--series-{number})", dash=dash)


def _curve(name: str, x: FloatArray, y: FloatArray, style: Style) -> Trace:
    return line(name, x, y, style) | {"x": encoded(x)}


def _bode(
    title: str,
    unit: str,
    curves: Mapping[str, ComplexArray],
    at_Hz: FloatArray,
    measured: Sequence[MeasuredResponse],
    caption: str,
) -> Figure:
    """Return magnitude, in dB where it is a pure number, and phase over frequency."""

    def level(values: FloatArray) -> FloatArray:
        return 20.0 * np.log10(values) if not unit else values

    gains = [
        _curve(name, at_Hz, level(np.abs(values)), _style(number))
        for number, (name, values) in enumerate(curves.items())
    ]
    phases = [
        _curve(name, at_Hz, np.degrees(np.unwrap(np.angle(values))), _style(number))
        for number, (name, values) in enumerate(curves.items())
    ]
    for number, item in enumerate(measured, start=len(curves)):
        points = {"mode": "markers", "marker": {"size": 4, "color": _style(number).colour}}
        gains.append(_curve(item.name, item.frequency_Hz, level(item.magnitude), _style(number)) | points)
        if item.phase_rad is not None:
            phases.append(_curve(item.name, item.frequency_Hz, np.degrees(item.phase_rad), _style(number)) | points)
    panels = [
        Panel(y_title=labelled("magnitude", unit or "dB"), traces=gains),
        Panel(y_title="phase (°)", traces=phases),
    ]
    figure = stack(title, panels, "frequency (Hz)", caption)
    scale: dict[str, Any] = {"type": "log"}
    figure.layout["xaxis"].update(scale)
    if unit:
        figure.layout["yaxis"].update({**scale, "exponentformat": "e"})
    return figure


def _tracking(system: LinearSystem, at_Hz: FloatArray, measured: Sequence[MeasuredResponse]) -> Iterator[Block]:
    response = system.tracking(at_Hz)
    if response is not None:
        caption = "Position over commanded position, feed-forward included; points are measured."
        yield _bode("Tracking", "", {"model": response}, at_Hz, measured, caption)


def _loops(system: LinearSystem, at_Hz: FloatArray) -> Iterator[Block]:
    curves = {name: system.loop_response(name, at_Hz) for name in system.loops}
    if not curves:
        return
    yield _bode("Bode diagram", "", curves, at_Hz, (), "")
    yield Grid([_nyquist(name, values, number) for number, (name, values) in enumerate(curves.items())])
    yield note("A cross marks -1; the closer the curve comes, the smaller the margins.")


def _nyquist(name: str, values: ComplexArray, number: int) -> Figure:
    drawn = np.where(np.abs(values) < 2.0 * FAR, values, np.nan)
    critical = {
        "type": "scatter",
        "mode": "markers",
        "x": [-1.0],
        "y": [0.0],
        "showlegend": False,
        "hoverinfo": "skip",
        "marker": {"symbol": "x", "size": 9, "color": "var(--ink)"},
    }
    horizontal = axis("real part") | {"range": [-FAR, 1.0]}
    vertical = axis("imaginary part") | {"range": [-FAR, 1.0], "scaleanchor": "x"}
    curve = _curve(plain(name), drawn.real, drawn.imag, _style(number)) | {"showlegend": False}
    return Figure(
        title=f"Nyquist diagram: {name}", traces=[curve, critical], layout=layout(horizontal, vertical), height_px=340
    )


def _steps(system: LinearSystem) -> Iterator[Block]:
    figures = []
    for number, name in enumerate(system.loops):
        if system.margins(name).stable:
            time_s, answer = system.step(name)
            thin = slice(None, None, max(1, len(time_s) // DRAWN_STEP))
            curve = _curve(name, time_s[thin], answer[thin], _style(number)) | {"showlegend": False}
            height = layout(axis("time (s)"), axis("answer to a step of 1"))
            figures.append(Figure(title=f"Closed loop: {name}", traces=[curve], layout=height, height_px=260))
    if figures:
        yield Grid(figures)


def _plant(system: LinearSystem, at_Hz: FloatArray, measured: Sequence[MeasuredResponse]) -> Iterator[Block]:
    found = system.plant_response(at_Hz)
    for j, source in enumerate(system.plant.input_labels):
        for i, name in enumerate(system.plant.output_labels):
            if not np.abs(found[i, j]).any():
                continue
            top, bottom = (UNITS[split_unit(label)[1]] for label in (name, source))
            top, bottom = (f"({part})" if set(part) & set(" /") else part for part in (top, bottom))
            unit = "" if top == bottom else f"{top}/{bottom}"
            title = f"{quantity(name)[0]} over {quantity(source)[0]}"
            yield _bode(title.capitalize(), unit, {"model": found[i, j]}, at_Hz, measured if i == j == 0 else (), "")
