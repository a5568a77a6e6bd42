"""Write a model as a Functional Mock-up Unit: description, sources, and a binary where a C compiler is at hand."""

import hashlib
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from fdbench.errors import FdbenchError, SpecError
from fdbench.fmu._stepper import stepper
from fdbench.plants._controllers import OpenLoop
from fdbench.plants.feed_drive import FeedDrive, Following
from fdbench.rotary import ROTARY, rotary_name
from fdbench.simulate import layout
from fdbench.simulate.system import Sampled, Setup, Timing
from fdbench.units import UNITS, split_unit
from fdbench.version import __version__

TEMPLATE = Path(__file__).with_name("unit.c")
IDENTIFIER = "axis"
FIRST_OUT = 100  # value reference
COMMANDS = ("reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
START = "start_position_m"
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden")
LONGEST_S = 120.0  # of a compiler
CHECKED_SAMPLES = 3
LARGEST_N = 1e12  # force of a motor without a controller
EPOCH = (1980, 1, 1, 0, 0, 0)  # of the files in it, so that a model gives the same file each time


class _Variable(NamedTuple):
    """A variable of the unit: its name, value reference, and what it is to the outside."""

    name: str
    reference: int
    causality: str


def write_fmu(drive: FeedDrive, axis: str, sampling_time_s: float, substeps: int, path: str | Path) -> str:
    """Write an axis as an FMU for co-simulation and return in words what it holds.

    Inputs are the commanded position, velocity and acceleration, or, where no controller is known, the motor's force or
    torque, each held over a communication step, which is a whole number of sampling times. Outputs are what the drive
    logs: after a step to the time t those of the sample at t minus one sampling time, with the force that was asked for
    there. All effects are in it but random ones. The result is what fdbench simulates, without noise, to the last bit
    where compiler and C library are those of the tests.

    Source: Modelica Association, Functional Mock-up Interface 2.0.5 (2024), sections 2.2 and 4.

    Parameters
    ----------
    drive : FeedDrive
        Of a rotary axis, that of its arc.
    axis : str
        ``linear`` or ``rotary``.
    sampling_time_s : float
        Of the controller.
    substeps : int
        Of the integration, in a sampling time.
    path : path
        The file; other than ``.fmu`` is refused.

    Raises
    ------
    SpecError
        If an effect cannot be written in C, the loop is unstable, or a substep too long.
    FdbenchError
        If the file cannot be written, or the compiler fails.
    """
    file = Path(path)
    if file.suffix.lower() != ".fmu":
        raise SpecError(f"{file}: an FMU is written as .fmu.")
    is_free = isinstance(drive.controller, Following) and drive.controller.mass_kg is None
    if is_free:
        drive = replace(drive, controller=OpenLoop(acceleration_feedforward_kg=0.0, force_limit_N=LARGEST_N))
    timing = Timing(sampling_time_s=sampling_time_s, duration_s=CHECKED_SAMPLES * sampling_time_s, substeps=substeps)
    system = drive.system(Setup(timing=timing, motion=Sampled(np.zeros((CHECKED_SAMPLES, 3)))))
    inputs = ("motor_force_N",) if is_free else COMMANDS
    outputs = {name: column for name, column in _columns(drive).items() if name in system.columns}
    called: Callable[[str], str] = rotary_name if axis == ROTARY else str
    variables = [
        *(_Variable(called(name), place, "input") for place, name in enumerate(inputs)),
        _Variable(called(START), len(inputs), "parameter"),
        *(_Variable(_output(called(name), inputs), FIRST_OUT + place, "output") for place, name in enumerate(outputs)),
    ]
    text = TEMPLATE.read_text("utf-8")
    for key, value in (
        ("NAME", IDENTIFIER),
        ("VERSION", __version__),
        ("STEPPER", stepper(drive, sampling_time_s, substeps)),
        ("N_IN", str(len(inputs))),
        ("COLUMNS", ", ".join(str(column) for column in outputs.values())),
    ):
        text = text.replace(f"@{key}@", value)
    guid = hashlib.sha256(text.encode()).hexdigest()[:32]
    text = text.replace("@GUID@", guid)
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "unit.c"
        source.write_text(text, "utf-8")
        binary, words = _compiled(source)
        content = {"modelDescription.xml": _description(variables, guid, sampling_time_s).encode(), **binary}
        content["sources/unit.c"] = text.encode()
    try:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in content.items():
                archive.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED)
    except OSError as error:
        raise FdbenchError(f"{file}: cannot be written: {error}.") from error
    return words


def _columns(drive: FeedDrive) -> dict[str, int]:
    return {
        "motor_position_m": layout.OUT_MOTOR,
        "table_position_m": layout.OUT_TABLE,
        "velocity_m_per_s": layout.OUT_VELOCITY,
        drive.motor.logged: layout.OUT_FORCE,
    }


def _output(name: str, inputs: tuple[str, ...]) -> str:
    """Return the name of an output; the force that is given back is not called like the one that is given."""
    return f"logged_{name}" if len(inputs) == 1 and name.startswith(("motor_force", "motor_torque")) else name


def _compiled(source: Path) -> tuple[dict[str, bytes], str]:
    """Return the binary, if this machine has a compiler for it, and in words what the unit holds."""
    compiler = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if compiler is None or sys.platform != "linux" or platform.machine() not in ("x86_64", "AMD64"):
        return {}, "sources in C only, which the host tool has to compile"
    library = source.with_name(f"{IDENTIFIER}.so")
    command = [compiler, *FLAGS, str(source), "-o", str(library), "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise FdbenchError(f"{compiler}: no FMU: compiling it takes more than {LONGEST_S:g} s.") from error
    if done.returncode != 0:
        raise FdbenchError(f"{compiler}: no FMU: it ended with {done.returncode}: {done.stderr.strip()[:400]}")
    return {
        f"binaries/linux64/{IDENTIFIER}.so": library.read_bytes()
    }, "a binary for Linux on x86-64, and its sources in C"


def _description(variables: list[_Variable], guid: str, sampling_time_s: float) -> str:
    """Return ``modelDescription.xml``."""
    units = sorted({_unit(item.name) for item in variables})
    outputs = [place for place, item in enumerate(variables, 1) if item.causality == "output"]
    step = f'"{float(sampling_time_s)!r}"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="2.0" modelName="{IDENTIFIER}" guid="{guid}" '
        f'generationTool="fdbench {__version__}" variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{IDENTIFIER}" canHandleVariableCommunicationStepSize="false">',
        '    <SourceFiles><File name="unit.c"/></SourceFiles>',
        "  </CoSimulation>",
        f"  <UnitDefinitions>{''.join(f'<Unit name={quoteattr(unit)}/>' for unit in units)}</UnitDefinitions>",
        f'  <DefaultExperiment startTime="0.0" stepSize={step}/>',
        "  <ModelVariables>",
        *(f"    {_variable(item)}" for item in variables),
        "  </ModelVariables>",
        "  <ModelStructure>",
    ]
    unknowns = "".join(f'<Unknown index="{place}"/>' for place in outputs)
    lines += [f"    <{element}>{unknowns}</{element}>" for element in ("Outputs", "InitialUnknowns")]
    return "\n".join([*lines, "  </ModelStructure>", "</fmiModelDescription>", ""])


def _variable(item: _Variable) -> str:
    kind = {
        "input": 'variability="continuous"',
        "parameter": 'variability="fixed" initial="exact"',
        "output": 'variability="discrete" initial="calculated"',
    }[item.causality]
    start = "" if item.causality == "output" else ' start="0.0"'
    return (
        f'<ScalarVariable name="{item.name}" valueReference="{item.reference}" causality="{item.causality}" {kind}>'
        f"<Real unit={quoteattr(_unit(item.name))}{start}/></ScalarVariable>"
    )


def _unit(name: str) -> str:
    return UNITS[split_unit(name)[1]]
