"""Plug-ins: an entry point names a package, the files in it name the plug-ins.

A module is imported when its name is asked for, so a file dropped into a named package is a plug-in at once.
"""

import ast
import contextlib
import importlib
import importlib.util
import inspect
import pkgutil
import sys
import traceback
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.machinery import PathFinder, SourceFileLoader
from importlib.metadata import entry_points
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Generic, NamedTuple, TypeVar, cast

from fdbench.errors import PluginError, UnknownName, did_you_mean
from fdbench.files import LONGEST_NAME, PLAIN_NAME

T = TypeVar("T")


class _Source(NamedTuple):
    """A plug-in in a package: its module path and its file."""

    module: str
    file: Path


class _Given(NamedTuple):
    """A plug-in that was given by its path, and its class once it has been imported."""

    file: Path
    found: Any = None


class Registry(Generic[T]):
    """The plug-ins of one kind: classes derived from ``base``, found by file name.

    Parameters
    ----------
    kind : str
        Noun for messages, such as ``"effect"``; the entry-point group is ``fdbench.<kind>s``.
    base : type
        Abstract class that every plug-in of this kind derives from. What it annotates as a class variable and gives
        no value, a plug-in has to give one.
    """

    def __init__(self, kind: str, base: type[T]) -> None:
        self.kind = kind
        self.base = base
        self._files: dict[str, _Given] = {}
        self._imported: dict[str, type[T]] = {}

    def packages(self) -> list[str]:
        """Return the packages that entry points name for this kind, in order of name."""
        return list(_packages(f"fdbench.{self.kind}s"))

    def modules(self) -> dict[str, str]:
        """Return the module path of each plug-in name, without importing any plug-in."""
        return {name: source.module for name, source in self._sources().items()}

    def names(self) -> list[str]:
        """Return all registered names, sorted."""
        return sorted({*self._sources(), *self._files})

    def get(self, name: str) -> type[T]:
        """Return the class registered as ``name``.

        Raises
        ------
        UnknownName
            If no file of that name exists; the message gives the nearest one.
        PluginError
            If the file exists but does not define exactly one plug-in of this kind.
        """
        if name in self._files:
            if self._files[name].found is None:
                self.add_file(self._files[name].file)
            return cast("type[T]", self._files[name].found)
        if name in self._imported:
            return self._imported[name]
        sources = self._sources()
        if name not in sources:
            file = f" A file is given as {name}.py." if Path(f"{name}.py").is_file() else ""
            raise UnknownName(f"unknown {self.kind} '{name}'.{did_you_mean(name, self.names())}{file}")
        try:
            module = importlib.import_module(sources[name].module)
        except (Exception, SystemExit) as error:
            place = f"{self.kind} '{name}' ({sources[name].module})"
            raise PluginError(f"{place} cannot be imported: {fault(error, sources[name].file)}") from error
        self._imported[name] = self._only_class(module, name)
        return self._imported[name]

    def summary(self, name: str) -> str:
        """Return the first line of the docstring of a plug-in's file, without importing it."""
        sources = self._sources()
        file = sources[name].file if name in sources else Path(inspect.getfile(self.get(name)))
        try:
            return (ast.get_docstring(ast.parse(file.read_bytes())) or "").split("\n")[0]
        except (OSError, SyntaxError, ValueError, RecursionError, MemoryError) as error:
            return f"cannot be read: {fault(error, file)}"

    def add_file(self, path: str | Path) -> str:
        """Register the plug-in in a Python file and return its name, the file's stem.

        The file of a plug-in that is registered already is left to its package.

        Raises
        ------
        PluginError
            If there is no such file, it cannot be imported, does not define exactly one plug-in of this kind, or has
            the name of another plug-in.
        """
        return add_file(path, (self,))

    def declare(self, name_or_file: str) -> str:
        """Return a registered name; a path ending in ``.py`` is noted, and imported when its class is asked for.

        Raises
        ------
        PluginError
            If there is no such file, or it has the name of another plug-in.
        """
        if not name_or_file.endswith(".py"):
            return name_or_file
        file = Path(name_or_file)
        if owner(file, (self,)) is None:
            self._files[file.stem] = _Given(lasting(file))
        return file.stem

    def files(self) -> dict[str, Path]:
        """Return the files of the plug-ins that were given by path, by name."""
        return {name: given.file for name, given in sorted(self._files.items())}

    def forget_files(self) -> None:
        """Know no plug-in any more that was given by path."""
        self._files.clear()

    def resolve(self, name_or_file: str) -> str:
        """Return a registered name; a path ending in ``.py`` is registered first."""
        return self.add_file(name_or_file) if name_or_file.endswith(".py") else name_or_file

    def _sources(self) -> Mapping[str, _Source]:
        found: dict[str, _Source] = {}
        for package in self.packages():
            folders = _folders(package)
            if not folders:
                raise PluginError(f"{self.kind} package '{package}' is named by an entry point but does not exist.")
            for folder in folders:
                for module in pkgutil.iter_modules([folder]):
                    file = f"{module.name}/__init__.py" if module.ispkg else f"{module.name}.py"
                    if not module.name.startswith("_"):
                        found.setdefault(module.name, _Source(f"{package}.{module.name}", Path(folder, file)))
        return found

    def _only_class(self, module: ModuleType, name: str) -> type[T]:
        derived = _classes(module, self.base)
        found = [value for value in derived if not inspect.isabstract(value)]
        if len(found) != 1:
            unfinished = [
                f"{value.__name__}, which lacks {' and '.join(sorted(value.__abstractmethods__))}"  # type: ignore[attr-defined]
                for value in derived
            ]
            names = ", ".join(value.__name__ for value in found)
            raise PluginError(
                f"{module.__file__}: a plug-in file defines exactly one {self.base.__name__}, found "
                f"{names or '; '.join(unfinished) or 'no class derived from it'}."
            )
        found[0].name = name  # type: ignore[attr-defined]
        for attribute in inspect.get_annotations(self.base):
            if "ClassVar" in str(inspect.get_annotations(self.base)[attribute]) and not hasattr(found[0], attribute):
                raise PluginError(f"{module.__file__}: {found[0].__name__} lacks the class attribute {attribute}.")
        return found[0]


def add_file(path: str | Path, registries: Sequence[Registry[Any]]) -> str:
    """Register the plug-in in a Python file, of whichever kind it is, and return its name; see `Registry.add_file`."""
    file = Path(path)
    own = owner(file, registries)
    if own is not None:
        own.get(file.stem)
        return file.stem
    module = _load(file, registries[0].kind)
    defined = [registry for registry in registries if _classes(module, registry.base)]
    if not defined and len(registries) > 1:
        bases = " or ".join(registry.base.__name__ for registry in registries)
        raise PluginError(f"{file}: a plug-in file defines a class derived from {bases}, found none.")
    registry = defined[0] if defined else registries[0]
    registry._files[file.stem] = _Given(lasting(file), registry._only_class(module, file.stem))
    return file.stem


def lasting(file: Path) -> Path:
    """Return a path that holds in another folder too; a link keeps its name, which is that of the plug-in."""
    return file.parent.resolve() / file.name


def owner(file: Path, registries: Sequence[Registry[Any]]) -> Registry[Any] | None:
    """Return the registry in whose packages a plug-in file lies, or None if it may be registered by its path."""
    if file.is_dir():
        raise PluginError(f"{file}: a folder, not a plug-in file.")
    if not file.is_file():
        beside = [other.name for other in file.parent.glob("*.py")] if file.parent.is_dir() else []
        hint = did_you_mean(file.name, beside) if beside else ""
        raise PluginError(f"{file}: no such file.{hint}")
    if file.suffix != ".py":
        raise PluginError(f"{file}: a plug-in file must end in .py.")
    if not PLAIN_NAME.fullmatch(file.stem):
        raise PluginError(
            f"{file}: the name of the file, without .py, is that of the plug-in; allowed: up to {LONGEST_NAME} "
            "letters, digits, blanks, _, - and ., the first of them a letter, a digit or _."
        )
    for registry in registries:
        source = registry._sources().get(file.stem)
        if source is not None and source.file.is_file() and source.file.samefile(file):
            return registry
        if source is not None:
            raise PluginError(
                f"{file}: the name {file.stem} belongs to the {registry.kind} {source.module}. Rename the file."
            )
    return None


@lru_cache(maxsize=32)
def _packages(group: str) -> tuple[str, ...]:
    return tuple(sorted({point.value for point in entry_points(group=group)}))


def _folders(package: str) -> list[str]:
    """Return the folders of a package, or none if there is no such package; no code of it is executed to find them."""
    top, *inner = package.split(".")
    specification = importlib.util.find_spec(top)
    for part in inner:
        if specification is None or not specification.submodule_search_locations:
            return []
        above = f"{specification.name}.{part}"
        specification = PathFinder.find_spec(above, specification.submodule_search_locations)
    return list(specification.submodule_search_locations or ()) if specification is not None else []


class _AlwaysCompiled(SourceFileLoader):
    """Leaves no compiled file behind, which would be taken for one that is edited within a second."""

    def get_code(self, fullname: str) -> CodeType:
        code: CodeType = self.source_to_code(self.get_data(self.path), self.path)
        return code


def _load(file: Path, kind: str) -> ModuleType:
    """Return the module of a plug-in file; what it prints goes to standard error, so that output stays clean."""
    # Without a dot, for a pickle would look for the package before it.
    name = f"fdbench_{kind}_file_{file.stem.replace('.', '_')}"
    path = file.resolve()
    loader = _AlwaysCompiled(name, str(path))
    specification = importlib.util.spec_from_loader(name, loader)
    if specification is None:
        raise PluginError(f"{file}: cannot be loaded.")
    module = importlib.util.module_from_spec(specification)
    before = sys.modules.get(name)
    sys.modules[name] = module
    try:
        with contextlib.redirect_stdout(sys.stderr):
            loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        if before is not None:
            sys.modules[name] = before
        raise PluginError(f"{file}: cannot be imported: {fault(error, path)}") from error
    return module


def fault(error: BaseException, file: Path) -> str:
    """Return an error in one line, with the last line of ``file`` that it passed.

    >>> fault(ValueError("not  this"), Path("a.py"))
    'ValueError: not this'
    """
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(file)]
    if isinstance(error, SyntaxError) and error.filename == str(file):
        lines, error_text = [error.lineno], error.msg
    else:
        error_text = str(error)
    where = f"line {lines[-1]}: " if lines and lines[-1] is not None else ""
    text = " ".join(error_text.split())
    return f"{where}{type(error).__name__}{f': {text}' if text else ''}"


def _classes(module: ModuleType, base: type[T]) -> list[type[T]]:
    """Return the classes that a module defines itself and that derive from ``base``."""
    values = dict.fromkeys(value for value in vars(module).values() if inspect.isclass(value))
    return [value for value in values if issubclass(value, base) and value.__module__ == module.__name__]
