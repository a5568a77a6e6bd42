"""Where the scenario files are; reads none of them."""

from pathlib import Path

PACKAGE = Path(__file__).parent


def scenario_folder() -> Path:
    """Return the folder of scenario files: the packaged copy, else the repository's."""
    packaged = PACKAGE / "_scenarios"
    return packaged if packaged.is_dir() else PACKAGE.parent / "scenarios"


def scenario_files() -> list[Path]:
    """Return the files of all scenarios, sorted by id."""
    return sorted(scenario_folder().glob("*.toml"))


def scenario_ids() -> list[str]:
    """Return the ids of all scenarios, without the namespace ``fdbench/``."""
    return [path.stem for path in scenario_files()]


def newest_ids() -> list[str]:
    """Return the ids of all scenarios of which there is no newer version."""
    newest: dict[str, str] = {}
    for name in sorted(scenario_ids(), key=lambda text: (text.rpartition("-v")[0], int(text.rpartition("-v")[2]))):
        newest[name.rpartition("-v")[0]] = name
    return sorted(newest.values())
