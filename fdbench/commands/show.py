"""``fdbench show``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, make_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from fdbench.catalogue import scenario_ids
from fdbench.checks.plugin_files import add_effects
from fdbench.commands._json import echo_json
from fdbench.commands._options import PLUGINS, SCENARIO, Effects, Json, file_to_write, names_of
from fdbench.commands._say import say
from fdbench.errors import FdbenchError, SpecError, UnknownName, did_you_mean
from fdbench.rotary import ROTARY, rotary_name

if TYPE_CHECKING:
    from fdbench.commands._sheets import NameSheet
    from fdbench.plants import LinearSystem, Plant

Rows = list[list[str]]


def show(
    source: Annotated[
        str,
        typer.Argument(
            autocompletion=names_of(SCENARIO, *PLUGINS, "format"),
            help="Any name of `fdbench list`; or the TOML file of a scenario or of a model.",
        ),
    ],
    measured: Annotated[
        list[Path] | None,
        typer.Argument(
            help="CSV of frequency_Hz, magnitude (or magnitude_dB; of the plant alone magnitude_m_per_N) and phase_rad "
            "(or phase_deg), or a record with a broadband motion: drawn beside the model."
        ),
    ] = None,
    sampling_time_s: Annotated[
        float | None,
        typer.Option("--sampling-time", min=1e-9, help="Of the controller, in s; for a model file, which has none."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", callback=file_to_write, help="HTML file for the diagrams.")
    ] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(callback=file_to_write, help="File for the model with its controller as an FMU (FMI 2.0), in C."),
    ] = None,
    json_: Json = False,
    effect: Effects = None,
) -> None:
    """Show what a name stands for; of a machine its linear model too: modes, margins, Bode, Nyquist and step."""
    from fdbench.commands._sheets import plugin_sheets, print_sheet

    add_effects(effect)
    sheets = plugin_sheets(source)
    if sheets and (measured or output or fmu or sampling_time_s is not None):
        raise SpecError(f"{source}: a {sheets[0].kind}, of which there is nothing to draw.")
    if sheets:
        if json_:
            echo_json([asdict(sheet) for sheet in sheets])
        else:
            for sheet in sheets:
                print_sheet(sheet)
        return
    machine = _read(source, sampling_time_s)
    if measured and output is None:
        raise SpecError(f"{measured[0]}: measured responses are drawn; name the page with --output.")
    if fmu is not None:
        say(f"{fmu}: {_write_fmu(source, machine, fmu)}", is_aside=True)
    try:
        system = machine.system()
    except FdbenchError as error:
        if machine.sheet is None or output is not None:
            raise
        system, reason = None, str(error)
    if json_:
        facts = {} if machine.sheet is None else {"scenario": asdict(machine.sheet)}
        echo_json({**facts, **({} if system is None else _answer(machine.name, system))})
    else:
        if machine.sheet is not None:
            print_sheet(machine.sheet)
        if system is None:
            typer.echo(reason)
        else:
            _print(machine.name, system)
    if system is not None and output is not None:
        from fdbench.report._measured_response import read_response
        from fdbench.report.linear import write_linear

        write_linear(machine.name, system, _tables(system), [read_response(path) for path in measured or ()], output)
    if system is not None:
        system.check()


def _write_fmu(source: str, machine: "_Machine", fmu: Path) -> str:
    from fdbench.diagnosis.model.nominal import load_nominal
    from fdbench.fmu import write_fmu

    nominal = load_nominal(source)
    return write_fmu(nominal.drive, nominal.axis, machine.sampling_time_s(), nominal.simulation.substeps, fmu)


class _Machine(NamedTuple):
    """What is shown of a scenario or of a model file, which has no sheet."""

    name: str
    plant: "Plant"
    sampling_time_s: Callable[[], float]
    sheet: "NameSheet | None" = None
    is_rotary: bool = False

    def system(self) -> "LinearSystem":
        """Return the linear model."""
        from fdbench.plants import LinearisedPlant

        if not isinstance(self.plant, LinearisedPlant):
            raise SpecError(f"{self.name}: no linear model is known of a {type(self.plant).name}.")
        system = self.plant.linear_system(self.sampling_time_s())
        return _of_rotary(system) if self.is_rotary else system


def _read(source: str, sampling_time_s: float | None) -> _Machine:
    from fdbench.commands._sheets import registries, scenario_sheet
    from fdbench.diagnosis.model.rotary_axis import plant_on_the_arc
    from fdbench.plants.feed_drive import FeedDrive, Following
    from fdbench.scenario import extended, load_scenario
    from fdbench.specification import read, snake_case

    if not source.endswith(".toml") and source.removeprefix("fdbench/") not in scenario_ids():
        names = [*(name for registry in registries() for name in registry.names()), *scenario_ids()]
        raise UnknownName(f"unknown name '{source}'.{did_you_mean(source, names)}")
    table = extended(Path(source))[0] if source.endswith(".toml") else {"estimation": {}}
    if "estimation" in table:
        scenario = load_scenario(source)
        if sampling_time_s is not None:
            raise SpecError(f"--sampling-time: {source} is a scenario, which has its own.")
        sheet = scenario_sheet(scenario, source)
        return _Machine(scenario.id, scenario.plant, lambda: scenario.context().sampling_time_s, sheet)
    if "plant" not in table:
        raise SpecError(f"{source}: no table [plant]; a scenario or a model file is expected.")
    if sampling_time_s is None:
        raise SpecError(f"{source}: a model file has no sampling time; add --sampling-time, in s.")
    own = dict(table["plant"])
    if own.get("kind") == snake_case(FeedDrive.__name__):
        own.setdefault("controller", {"kind": snake_case(Following.__name__)})
    is_rotary = table.get("axis") == ROTARY
    if is_rotary:
        own = plant_on_the_arc(own, f"{Path(source).name}: model.plant")
    plant = read(_model_file(), {"plant": own}, f"{Path(source).name}: model").plant
    return _Machine(Path(source).stem, plant, lambda: sampling_time_s, is_rotary=is_rotary)


def _of_rotary(system: "LinearSystem") -> "LinearSystem":
    """Return the linear model of an arc with inputs and outputs that are called as on the rotary axis."""
    import control

    own = system.plant
    inputs, outputs = ([rotary_name(label) for label in labels] for labels in (own.input_labels, own.output_labels))
    plant = control.ss(own.A, own.B, own.C, own.D, inputs=inputs, outputs=outputs)
    return replace(system, plant=plant)


def _model_file() -> "type[Any]":
    """Return what is read of a model file; its other tables are of the diagnosis."""
    from fdbench.plants import Plant

    return make_dataclass("Model", [("plant", Plant)], frozen=True)


def _answer(name: str, system: "LinearSystem") -> dict[str, object]:
    return {
        "name": name,
        "sampling_time_s": system.sampling_time_s,
        "delay_s": system.delay_s,
        "modes": [asdict(mode) for mode in system.modes()],
        "closed_loop_modes": [asdict(mode) for mode in system.closed_modes()],
        "loops": {loop: asdict(system.margins(loop)) for loop in system.loops},
    }


def _tables(system: "LinearSystem") -> list[tuple[str, Sequence[str], Rows]]:
    """Return title, header and rows of each table."""
    head = ["frequency", "damping ratio"]
    found: list[tuple[str, Sequence[str], Rows]] = []
    for title, modes in (("Modes of the plant", system.modes()), ("Modes of the closed loop", system.closed_modes())):
        rows = [
            ["0 Hz", "free"]
            if math.isnan(mode.damping_ratio)
            else [f"{mode.frequency_Hz:.4g} Hz", f"{mode.damping_ratio:.3g}"]
            for mode in modes
        ]
        found += [(title, head, rows)] if rows else []
    rows = []
    for name in system.loops:
        own = system.margins(name)
        rows.append(
            [
                name,
                "stable" if own.stable else "UNSTABLE",
                _number(own.bandwidth_Hz, "Hz"),
                _number(own.crossover_Hz, "Hz"),
                f"{own.gain_margin:.3g} ({20.0 * math.log10(own.gain_margin):.3g} dB)"
                if math.isfinite(own.gain_margin)
                else "infinite",
                _number(math.degrees(own.phase_margin_rad), "°"),
                _number(1e3 * own.delay_margin_s, "ms"),
                f"{own.sensitivity_peak:.3g}",
            ]
        )
    head = [
        "loop",
        "closed",
        "bandwidth",
        "crossover",
        "gain margin",
        "phase margin",
        "delay margin",
        "sensitivity peak",
    ]
    return found + ([("Loops", head, rows)] if rows else [])


def _number(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if math.isfinite(value) else "–"


def _print(name: str, system: "LinearSystem") -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console()
    console.print(
        f"{name}: one sample each {1e3 * system.sampling_time_s:.4g} ms, dead time {1e3 * system.delay_s:.4g} ms"
    )
    for title, head, rows in _tables(system):
        table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        for number, column in enumerate(head):
            table.add_column(column, justify="right" if number else "left", overflow="fold")
        for row in rows:
            table.add_row(*row)
        console.print(table)
