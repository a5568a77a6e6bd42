"""Where a score comes from: digests of the code that made it, versions, commit, machine and run."""

import ast
import hashlib
import importlib.util
import json
import os
import platform
import subprocess
import uuid
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import numpy as np

from fdbench.effects import effects
from fdbench.errors import PluginError
from fdbench.estimator import estimators
from fdbench.files import parsed
from fdbench.metrics import metrics
from fdbench.motions import motions
from fdbench.plants import plants
from fdbench.registry import Registry
from fdbench.sandbox import Source, own_files
from fdbench.version import __version__

PACKAGE = Path(__file__).parent.parent

# Beginnings of the paths, within the package, of what uses scores and has no part in making them.
USERS_OF_SCORES = (
    *("api/", "cli.py", "commands/", "checks/", "diagnosis/", "envs/", "fmu/", "proposal/", "report/"),
    *("reproduce/", "templates/", "trials/", "virtual_axes/"),
    *("benchmark/compare", "benchmark/console", "benchmark/leaderboard", "benchmark/seal"),
    *("benchmark/statistics", "benchmark/verify"),
)

# Names the runs whose times may be compared, as those that one job of a CI measured one after another.
RUN_ID = "FDBENCH_RUN_ID"

SIMULATION: tuple[Registry[Any], ...] = (effects, plants, motions, metrics)


def provenance() -> dict[str, str]:
    """Return the columns that say which code, versions and machine made a score, and in which run."""
    return {
        "code_digest": code_digest(),
        "fdbench_version": __version__,
        "commit": commit(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "machine": machine(),
        "run_id": os.environ.get(RUN_ID) or uuid.uuid4().hex,
    }


def plugin_files(registry: Registry[Any]) -> dict[str, Path]:
    """Return the files of the plug-ins that were registered by path, by name."""
    return registry.files()


def _code_of_packages() -> list[Path]:
    outside = {name.split(".")[0] for registry in SIMULATION for name in registry.packages()} - {"fdbench"}
    own = sorted(PACKAGE.rglob("*.py"))
    files = [path for path in own if not path.relative_to(PACKAGE).as_posix().startswith(USERS_OF_SCORES)]
    return files + [path for name in sorted(outside) for path in sorted(package_folder(name).rglob("*.py"))]


@lru_cache(maxsize=1)
def digest_of_packages() -> str:
    """Return the SHA-256 of what simulates and scores of this package and of installed ones, as it was at first use."""
    return digest(path.read_bytes() for path in _code_of_packages())


def code_digest() -> str:
    """Return the SHA-256 of everything that simulates and scores, plug-ins included, as it was at first use."""
    files = [path for registry in SIMULATION for path in plugin_files(registry).values()]
    return digest([digest_of_packages().encode(), *(path.read_bytes() for path in files)])


def digest(parts: Iterable[bytes]) -> str:
    """Return the SHA-256 of parts; where one ends and the next begins counts.

    >>> digest([b"ab", b"c"]) == digest([b"a", b"bc"])
    False
    """
    total = hashlib.sha256()
    for part in parts:
        total.update(hashlib.sha256(part).digest())
    return total.hexdigest()


def estimator_digest(files: Iterable[Path], arguments: Mapping[str, Any]) -> str:
    """Return the SHA-256 of an estimator's source files and constructor arguments."""
    return digest([json.dumps(arguments, sort_keys=True).encode(), *(path.read_bytes() for path in files)])


def estimator_source(name: str, files: Sequence[Path] | None = None) -> Source:
    """Return where a registered estimator is, made of these files; which they are takes a while to find out."""
    by_path = estimators.files()
    if name in by_path:
        own = own_files(by_path[name]) if files is None else tuple(files)
        return Source(name=name, own=own, digest=estimator_digest(own, {}), file=by_path[name])
    module = estimators.modules()[name]
    digest = estimator_digest(source_files(module) if files is None else files, {})
    return Source(name=name, own=(package_folder(module.split(".")[0]).resolve(),), digest=digest)


def source_files(module: str) -> list[Path]:
    """Return the file of a module and those of the same top-level package that it imports, directly or not.

    Found by reading, not by importing, so a plug-in that cannot be imported has a digest too.
    """
    root = package_folder(module.split(".")[0])
    found: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file_of(root, name)
        if path is None or name in found:
            continue
        found[name] = path
        waiting += sorted(_imports(parsed(path), name, path.name == "__init__.py"))
    return [found[name] for name in sorted(found)]


def package_folder(package: str) -> Path:
    """Return the folder of a package, which is found but not imported."""
    specification = importlib.util.find_spec(package)
    if specification is None or not specification.submodule_search_locations:
        raise PluginError(f"package '{package}' cannot be found.")
    return Path(next(iter(specification.submodule_search_locations)))


def _file_of(root: Path, module: str) -> Path | None:
    path = root.joinpath(*module.split(".")[1:])
    candidates = (path / "__init__.py", path.parent / f"{path.name}.py")
    return next((file for file in candidates if file.is_file()), None)


def _imports(tree: ast.Module, module: str, is_package: bool) -> set[str]:
    """Return what may be modules of the same top-level package among the names that a module imports."""
    names = {".".join(module.split(".")[:end]) for end in range(1, module.count(".") + 1)}
    package = module if is_package else module.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            with suppress(ImportError):  # beyond its package, which is told where it is imported
                source = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
                names |= {source, *(f"{source}.{alias.name}" for alias in node.names)}
    top = module.split(".")[0]
    return {name for name in names if name.split(".")[0] == top}


@lru_cache(maxsize=1)
def commit() -> str:
    """Return the git commit of the checkout that the package lies in, ``-dirty`` with changes, or "" outside one."""
    try:
        is_tracked = _git("ls-files", "__init__.py") != ""
        return _git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*") if is_tracked else ""
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=PACKAGE, capture_output=True, text=True, timeout=20, check=True)
    return done.stdout.strip()


@lru_cache(maxsize=1)
def machine() -> str:
    """Return the model of the processor."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text("utf-8").splitlines() if information.is_file() else []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()
