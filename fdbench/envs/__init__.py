"""Gymnasium environments of the simulated scenarios; thin, without physics of their own."""

from fdbench.catalogue import scenario_files


def register_all() -> None:
    """Register ``fdbench/<id>`` for every scenario file with a table ``[environment]``; a second call does nothing.

    No file is parsed. The environment asks for a reset itself and is checked by the tests, so that `gymnasium.make`
    adds no wrappers, which would take 0.2 us a step.
    """
    import gymnasium

    for path in scenario_files():
        name = f"fdbench/{path.stem}"
        if name not in gymnasium.registry and b"\n[environment]" in path.read_bytes():
            gymnasium.register(
                name,
                entry_point="fdbench.envs.drive_env:DriveEnv",
                vector_entry_point="fdbench.envs.drive_vector_env:DriveVectorEnv",
                kwargs={"scenario": path.stem},
                order_enforce=False,
                disable_env_checker=True,
            )


def environment_ids() -> list[str]:
    """Return the ids of all registered environments, sorted."""
    import gymnasium

    register_all()
    return sorted(name for name in gymnasium.registry if name.startswith("fdbench/"))
