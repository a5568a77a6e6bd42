"""Plug-ins that are given as files: registered, and refused where they cannot work."""

import os
from collections.abc import Iterable
from pathlib import Path

from fdbench.benchmark.variant import registered
from fdbench.errors import PluginError


def add_effects(files: Iterable[str | Path] | None) -> None:
    """Register effects by their files, and refuse those whose kernel does not fit what they declare."""
    if not files:
        return
    from functools import partial

    from fdbench.checks._report import run_checks
    from fdbench.checks.check_effect import (
        CheckedEffect,
        EffectBench,
        declares_what_the_kernel_takes,
        returns_finite_values,
    )
    from fdbench.effects import effects

    for file in distinct(files):
        effect = effects.get(effects.add_file(file))
        case = CheckedEffect(effect, EffectBench([effect]))
        for fits in (declares_what_the_kernel_takes, returns_finite_values):
            run_checks(file, [(fits.__name__, partial(fits, case))])


def distinct(names_or_files: Iterable[str | Path]) -> list[str]:
    """Return names and files as texts; two files of one name are refused, for the file name is the plug-in's.

    Arguments in brackets are none of the name.
    """
    every = [str(item) for item in names_or_files]
    given: dict[str, Path] = {}
    for file in (Path(item) for item in map(registered, every) if item.endswith(".py")):
        if os.path.realpath(given.setdefault(file.stem, file)) != os.path.realpath(file):
            raise PluginError(f"{given[file.stem]} and {file}: two plug-ins of one name. Rename one of the files.")
    return every
