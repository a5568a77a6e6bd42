"""Gymnasium environments of the simulated scenarios; thin, without physics of their own."""

import re
from pathlib import Path

from fdbench.catalogue import scenario_files

_EXTENDS = re.compile(rb'^extends = "([^"\n]+)"$', re.M)


NAMESPACE, DRAWN_NAMESPACE = "fdbench", "fdbench-drawn"


def register_all() -> None:
    """Register ``fdbench/<id>`` for every scenario file with a table ``[environment]``; a second call does nothing.

    Those that extend one, to draw a machine for each seed, are ``fdbench-drawn/<id>``: a later version in one namespace
    would make Gymnasium call the published trial out of date. No file is parsed. The environment asks for a reset
    itself and is checked by the tests, so that `gymnasium.make` adds no wrappers, which would take 0.2 us a step.
    """
    import gymnasium

    for path in scenario_files():
        namespace = _namespace(path)
        name = f"{namespace}/{path.stem}"
        if namespace and name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="fdbench.envs.drive_env:DriveEnv",
                vector_entry_point="fdbench.envs.drive_vector_env:DriveVectorEnv",
                kwargs={"scenario": path.stem},
                order_enforce=False,
                disable_env_checker=True,
            )


def _namespace(file: Path) -> str:
    """Return where a scenario file is registered: nowhere, if neither it nor what it extends has an environment."""
    text = file.read_bytes()
    if b"\n[environment]" in text:
        return NAMESPACE
    base = _EXTENDS.search(text)
    return DRAWN_NAMESPACE if base is not None and _namespace(file.with_stem(base[1].decode())) else ""


def environment_ids(namespace: str = NAMESPACE) -> list[str]:
    """Return the ids of all registered environments of a namespace, sorted."""
    import gymnasium

    register_all()
    return sorted(name for name in gymnasium.registry if name.startswith(f"{namespace}/"))
