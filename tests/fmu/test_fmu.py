"""The FMU of a model gives, to the last bit, what fdbench simulates of it."""

import ctypes
import dataclasses
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import REPOSITORY
from typer.testing import CliRunner

from fdbench import cli
from fdbench.diagnosis.model.nominal import Nominal, load_nominal
from fdbench.effects import Effect, Port, effects, kernel, parameter
from fdbench.errors import SpecError
from fdbench.fmu import write_fmu
from fdbench.fmu._translate import Translator
from fdbench.plants.feed_drive import FeedDrive
from fdbench.simulate.system import Sampled, Setup, Timing

PERIOD_S, SUBSTEPS, SAMPLES = 1e-3, 10, 1200
EACH = [name for name in effects.names() if not effects.get(name).random]
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")


def reference() -> np.ndarray:
    """Back and forth, with rests."""
    time_s = PERIOD_S * np.arange(SAMPLES)
    position = 0.02 * (1.0 - np.cos(2.0 * np.pi * np.minimum(time_s, 1.0) / 0.5))
    velocity = np.gradient(position, PERIOD_S)
    return np.column_stack((position, velocity, np.gradient(velocity, PERIOD_S)))


def simulated(drive: FeedDrive, commanded: np.ndarray) -> dict[str, np.ndarray]:
    timing = Timing(sampling_time_s=PERIOD_S, duration_s=len(commanded) * PERIOD_S, substeps=SUBSTEPS)
    axis = drive.system(Setup(timing=timing, motion=Sampled(commanded)))
    axis.start([0])
    rows = axis.advance(axis.n_samples)[:, :, 0]
    return {name: rows[:, place] for place, name in enumerate(axis.columns)}


class Unit:
    """The binary of an FMU, called as a host tool does."""

    def __init__(self, file: Path, place: Path) -> None:
        with zipfile.ZipFile(file) as archive:
            archive.extractall(place)
        description = ElementTree.parse(place / "modelDescription.xml").getroot()
        self.references = {
            item.get("name"): int(item.get("valueReference", "")) for item in description.iter("ScalarVariable")
        }
        self._library = ctypes.CDLL(str(place / "binaries" / "linux64" / "axis.so"))
        self._library.fmi2Instantiate.restype = ctypes.c_void_p
        guid = description.get("guid", "").encode()
        self._unit = ctypes.c_void_p(self._library.fmi2Instantiate(b"x", 1, guid, b"", None, 0, 0))
        assert self._unit

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._library.fmi2SetReal(
                self._unit, (ctypes.c_uint * 1)(self.references[name]), ctypes.c_size_t(1), (ctypes.c_double * 1)(value)
            )

    def get(self, name: str) -> float:
        value = (ctypes.c_double * 1)()
        status = self._library.fmi2GetReal(
            self._unit, (ctypes.c_uint * 1)(self.references[name]), ctypes.c_size_t(1), value
        )
        assert status == 0
        return value[0]

    def start(self) -> None:
        assert self._library.fmi2ExitInitializationMode(self._unit) == 0

    def step(self, step_s: float) -> int:
        return int(self._library.fmi2DoStep(self._unit, ctypes.c_double(0.0), ctypes.c_double(step_s), 1))

    def free(self) -> None:
        self._library.fmi2FreeInstance(self._unit)


def run_unit(unit: Unit, commanded: np.ndarray, names: list[str]) -> dict[str, np.ndarray]:
    found: dict[str, list[float]] = {name: [] for name in names}
    unit.set({"start_position_m": commanded[0, 0]})
    unit.start()
    for row in commanded:
        keys = "reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2"
        unit.set(dict(zip(keys, row, strict=True)))
        assert unit.step(PERIOD_S) == 0
        for name in names:
            found[name].append(unit.get(name))
    unit.free()
    return {name: np.array(values) for name, values in found.items()}


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return load_nominal(REPOSITORY / "scenarios" / "BallScrewAxis-v1.toml")


@needs_compiler
def test_an_axis_with_every_effect_is_what_is_simulated(nominal: Nominal, tmp_path: Path) -> None:
    known = tuple(effects.get(name).typical() for name in EACH)
    drive = dataclasses.replace(nominal.drive, effects=known)
    words = write_fmu(drive, "linear", PERIOD_S, SUBSTEPS, tmp_path / "a.fmu")
    assert words == "a binary for Linux on x86-64, and its sources in C"
    expected = simulated(drive, reference())
    names = ["motor_position_m", "table_position_m", "velocity_m_per_s", "motor_torque_Nm"]
    found = run_unit(Unit(tmp_path / "a.fmu", tmp_path / "a"), reference(), names)
    assert np.ptp(expected["table_position_m"]) > 0.03
    for name in names:
        np.testing.assert_array_equal(found[name], expected[name])


@needs_compiler
def test_fmpy_finds_a_valid_unit_that_is_what_is_simulated(nominal: Nominal, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="pip install 'fdbench[fmu]' installs fmpy")
    file = tmp_path / "a.fmu"
    result = CliRunner().invoke(cli.app, ["show", "BallScrewAxis-v1", "--fmu", str(file), "--json"])
    assert result.exit_code == 0, result.output
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(file)) == []
    commanded, time_s = reference(), PERIOD_S * np.arange(SAMPLES)
    kinds = ["time", "reference_position_m", "reference_velocity_m_per_s", "reference_acceleration_m_per_s2"]
    signals = np.array(
        [(at, *row) for at, row in zip(time_s, commanded, strict=True)], [(name, float) for name in kinds]
    )
    found = fmpy.simulate_fmu(
        str(file), stop_time=SAMPLES * PERIOD_S, step_size=PERIOD_S, output_interval=PERIOD_S, input=signals
    )
    expected = simulated(nominal.drive, commanded)
    for name in ("motor_position_m", "table_position_m", "motor_torque_Nm"):
        largest = np.abs(expected[name]).max()
        np.testing.assert_allclose(found[name][1:], expected[name], rtol=0.0, atol=1e-9 * largest)


@needs_compiler
def test_a_model_without_a_controller_takes_forces(nominal: Nominal, tmp_path: Path) -> None:
    file = tmp_path / "model.toml"
    file.write_text(
        '[plant]\nkind = "feed_drive"\ntravel_m = 1.0\nvelocity_limit_m_per_s = 1.0\n[plant.motor]\n'
        'kind = "linear_motor"\nmass_kg = 2.0\nviscous_friction_N_s_per_m = 0.0\n[simulation]\nsubsteps = 10\n'
    )
    result = CliRunner().invoke(
        cli.app, ["show", str(file), "--sampling-time", "1e-3", "--fmu", str(tmp_path / "a.fmu")]
    )
    assert result.exit_code == 0, result.output
    unit = Unit(tmp_path / "a.fmu", tmp_path / "a")
    unit.set({"motor_force_N": 4.0})
    unit.start()
    assert unit.step(0.1) == 0  # 100 samples: v = 0.2 m/s, x = 10 mm; logged at the begin of the last
    assert unit.get("velocity_m_per_s") == pytest.approx(2.0 * 0.099, rel=1e-12)
    assert unit.get("motor_position_m") == pytest.approx(0.5 * 2.0 * 0.099**2, rel=1e-12)
    assert unit.get("logged_motor_force_N") == 4.0
    assert unit.step(0.0004) == 3  # no whole number of samples
    unit.set({"motor_force_N": 1e6})
    assert unit.step(0.1) == 3  # beyond the travel
    unit.free()


def test_what_cannot_be_in_an_fmu_is_refused(nominal: Nominal, tmp_path: Path) -> None:
    random = dataclasses.replace(nominal.drive, effects=(effects.get("dropped_samples").typical(),))
    with pytest.raises(SpecError, match=r"dropped_samples is random; an FMU gives the same each time"):
        write_fmu(random, "linear", PERIOD_S, SUBSTEPS, tmp_path / "a.fmu")
    with pytest.raises(SpecError, match=r"a\.zip: an FMU is written as \.fmu"):
        write_fmu(nominal.drive, "linear", PERIOD_S, SUBSTEPS, tmp_path / "a.zip")
    assert not list(tmp_path.iterdir())


def test_without_a_compiler_there_are_the_sources(
    nominal: Nominal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    words = write_fmu(nominal.drive, "linear", PERIOD_S, SUBSTEPS, tmp_path / "a.fmu")
    assert words == "sources in C only, which the host tool has to compile"
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        assert sorted(archive.namelist()) == ["modelDescription.xml", "sources/unit.c"]


def test_what_is_not_translated_is_said() -> None:
    def odd(x):  # type: ignore[no-untyped-def]
        return (sum([x, x]), 0.0)

    with pytest.raises(SpecError, match=r"odd: not written in C for an FMU: \[x, x\]"):
        Translator().add(odd, "odd")


def test_words_of_kernels(tmp_path: Path) -> None:
    """Each word that no effect of this package says, so that others may."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler on this machine")

    def inner(a, b):  # type: ignore[no-untyped-def]
        return a + b, a % b

    def spoken(x, y):  # type: ignore[no-untyped-def]
        total = 0.0
        for k in range(1, 4):
            total += x**k
        first, second = inner(total, y)
        if not 0.0 < x <= 2.0 and y > 0.0:
            total -= max(x, y, 3.0)
        elif x == 2.0:
            total = 7 / 2
        return (total, first, second) if y > -100.0 else (0.0, 0.0, 0.0)

    import subprocess

    translator = Translator()
    assert translator.add(spoken, "spoken") == 3
    helpers = (REPOSITORY / "fdbench" / "fmu" / "unit.c").read_text().split("@STEPPER@")[0]
    (tmp_path / "a.c").write_text(
        "\n".join([helpers, *translator.functions]).replace("static void spoken", "void spoken")
    )
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-w", str(tmp_path / "a.c"), "-o", str(tmp_path / "a.so"), "-lm"], check=True
    )
    library = ctypes.CDLL(str(tmp_path / "a.so"))
    for x, y in ((1.5, 2.0), (-1.5, 2.0), (2.0, -3.0), (-4.0, -0.7), (1.0, -200.0)):
        result = (ctypes.c_double * 3)()
        library.spoken(ctypes.c_double(x), ctypes.c_double(y), result)
        np.testing.assert_allclose(list(result), spoken(x, y), rtol=1e-15, err_msg=f"{x}, {y}")


class EndStopSpring(Effect):
    """As the README has it: a kernel that returns one of two tuples."""

    port, amplitude = Port.TABLE_FORCE, "buffer_stiffness_N_per_m"
    buffer_stiffness_N_per_m: float = parameter("k", low=0.0, high=1e6, typical=2000.0)
    contact_position_m: float = parameter("x_0", low=-1.0, high=1.0, typical=0.02)

    @kernel
    def kernel(t, h, x, v, u, k, x_0):
        return (k * (x - x_0), k * h) if x > x_0 else (0.0, 0.0)


def test_a_kernel_of_ones_own_is_translated() -> None:
    translator = Translator()
    assert translator.add(EndStopSpring.kernel, "own") == 2
    assert "if ((x > x_0)) {" in translator.functions[0]
