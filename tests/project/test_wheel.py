"""What a user gets from the registry: the built wheel, opened."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(REPOSITORY)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def test_top_level_is_the_two_packages(wheel_names: list[str]) -> None:
    top_level = {name.split("/")[0] for name in wheel_names}
    packages = {name for name in top_level if not name.endswith(".dist-info")}
    assert packages == {"fdbench", "fdbench_baselines"}
    assert len(top_level - packages) == 1


def test_every_scenario_is_packaged(wheel_names: list[str]) -> None:
    scenarios = {path.name for path in (REPOSITORY / "scenarios").glob("*.toml")}
    packaged = {name.rsplit("/", 1)[1] for name in wheel_names if name.startswith("fdbench/_scenarios/")}
    assert scenarios
    assert packaged == scenarios


@pytest.mark.parametrize("source", ["fdbench", "baselines/fdbench_baselines"])
def test_every_source_file_is_packaged(wheel_names: list[str], source: str) -> None:
    folder = REPOSITORY / source
    kinds = (".py", ".html", ".css", ".js", ".svg", ".txt")
    files = {path.relative_to(folder.parent).as_posix() for path in folder.rglob("*") if path.suffix in kinds}
    assert files <= set(wheel_names)
    assert f"{folder.name}/py.typed" in wheel_names
