"""A scenario short enough for tests that run it many times."""

from pathlib import Path

from conftest import REPOSITORY


def short_scenario(folder: Path, name: str, **changes: str) -> str:
    """Write the shaker scenario with 3 s in place of 12, and return its path."""
    text = (REPOSITORY / "scenarios" / "ShakerConstant-v0.toml").read_text("utf-8")
    short = {
        "duration_s = 12.0": "duration_s = 3.0",
        "hold_s = 0.6306306306306306": "hold_s = 0.15",
        "start_s = 2.0": "start_s = 0.3",
        "stop_s = 10.0": "stop_s = 2.9",
        "window_s = [2.4, 9.6]": "window_s = [0.4, 2.8]",
        **changes,
    }
    for old, new in short.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{name}.toml"
    path.write_text(text, "utf-8")
    return str(path)
