"""The page of a linear model: modes, margins, Bode and Nyquist diagrams, step, measured responses beside it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fdbench.plants import LinearSystem
from fdbench.record import FloatArray
from fdbench.report._figures import INK, Curve, Figure, Panel, Style, labelled, numbered
from fdbench.report._measured_response import MeasuredResponse
from fdbench.report._page import Block, Grid, Section, note, paragraph, table, write_page
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
        Drawn beside the tracking, or beside the plant where it has no controller or they are of the plant alone.
    output : path

    Raises
    ------
    FdbenchError
        If the file cannot be written.
    """
    at_Hz = np.geomspace(LOWEST, 1.0, POINTS) * 0.5 / system.sampling_time_s
    sections = [Section(title, [table(head, rows, "l" + "r" * (len(head) - 1))]) for title, head, rows in tables]
    beside_plant = [item for item in measured if item.is_of_plant or system.closed is None]
    sections += [
        Section("Tracking", list(_tracking(system, at_Hz, [item for item in measured if not item.is_of_plant]))),
        Section("Open loops", list(_loops(system, at_Hz))),
        Section("Step", list(_steps(system))),
        Section("Plant", list(_plant(system, at_Hz, beside_plant))),
    ]
    lead = [
        paragraph(
            f"Nominal linear model of {name}, one sample each {1e3 * system.sampling_time_s:.4g} ms, with dead times, "
            "sampling and controller. Of friction it has the slope at speed; force limits are left out."
        )
    ]
    write_page(output, f"fdbench: linear model of {name}", lead, [part for part in sections if part.blocks])


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

    gains, phases = [], []
    for number, (name, values) in enumerate(curves.items()):
        gain = Curve(name=name, x=at_Hz, y=level(np.abs(values)), style=numbered(number))
        gains.append(gain)
        phases.append(replace(gain, y=np.degrees(np.unwrap(np.angle(values)))))
    for number, item in enumerate(measured, start=len(curves)):
        x, style = item.frequency_Hz, numbered(number)
        gain = Curve(name=item.name, x=x, y=level(item.magnitude), style=style, points=True)
        gains.append(gain)
        if item.phase_rad is not None:
            phases.append(replace(gain, y=np.degrees(item.phase_rad)))
    panels = [
        Panel(y_title=labelled("magnitude", unit or "dB"), items=gains, y_log=bool(unit)),
        Panel(y_title="phase (°)", items=phases),
    ]
    return Figure(title=title, panels=panels, x_title="frequency (Hz)", x_log=True, caption=caption)


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
    yield note("A point marks -1; the closer the curve comes, the smaller the margins.")


def _nyquist(name: str, values: ComplexArray, number: int) -> Figure:
    drawn = np.where(np.abs(values) < 2.0 * FAR, values, np.nan)
    items = [
        Curve(name=name, x=drawn.real, y=drawn.imag, style=numbered(number)),
        Curve(name="-1", x=np.array([-1.0]), y=np.zeros(1), style=Style(colour=INK), points=True, width=2.0),
    ]
    panel = Panel(y_title="imaginary part", items=items, y_range=(-FAR, 1.0), height_px=300)
    return Figure(title=f"Nyquist diagram: {name}", panels=[panel], x_title="real part", x_range=(-FAR, 1.0))


def _steps(system: LinearSystem) -> Iterator[Block]:
    figures = []
    for number, name in enumerate(system.loops):
        if system.margins(name).stable:
            time_s, answer = system.step(name)
            thin = slice(None, None, max(1, len(time_s) // DRAWN_STEP))
            curve = Curve(name=name, x=time_s[thin], y=answer[thin], style=numbered(number))
            panel = Panel(y_title="answer to a step of 1", items=[curve])
            figures.append(Figure(title=f"Closed loop: {name}", panels=[panel], x_title="time (s)"))
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
