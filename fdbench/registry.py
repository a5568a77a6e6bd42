"""Plug-ins: an entry point names a package, the files in it name the plug-ins.

A module is imported when its name is asked for, so a file dropped into a named package is a plug-in at once.
"""

import ast
import importlib
import importlib.util
import inspect
import pkgutil
import sys
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from fdbench.errors import PluginError, UnknownName, did_you_mean

T = TypeVar("T")


class Registry(Generic[T]):
    """The plug-ins of one kind: classes derived from ``base``, found by file name.

    Parameters
    ----------
    kind : str
        Noun for messages, such as ``"effect"``; the entry-point group is ``fdbench.<kind>s``.
    base : type
        Abstract class that every plug-in of this kind derives from.
    """

    def __init__(self, kind: str, base: type[T]) -> None:
        self.kind = kind
        self.base = base
        self._files: dict[str, type[T]] = {}

    def packages(self) -> list[str]:
        """Return the packages that entry points name for this kind, in order of name."""
        return sorted({point.value for point in entry_points(group=f"fdbench.{self.kind}s")})

    def modules(self) -> dict[str, str]:
        """Return the module path of each plug-in name, without importing any plug-in."""
        found: dict[str, str] = {}
        for package in self.packages():
            try:
                specification = importlib.util.find_spec(package)
            except ImportError as error:
                raise PluginError(f"{self.kind} package '{package}' cannot be found: {error}") from error
            if specification is None or not specification.submodule_search_locations:
                raise PluginError(f"{self.kind} package '{package}' is named by an entry point but does not exist.")
            for module in pkgutil.iter_modules(specification.submodule_search_locations):
                if not module.name.startswith("_"):
                    found.setdefault(module.name, f"{package}.{module.name}")
        return found

    def names(self) -> list[str]:
        """Return all registered names, sorted."""
        return sorted({*self.modules(), *self._files})

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
            return self._files[name]
        modules = self.modules()
        if name not in modules:
            raise UnknownName(f"unknown {self.kind} '{name}'.{did_you_mean(name, self.names())}")
        try:
            module = importlib.import_module(modules[name])
        except Exception as error:
            raise PluginError(f"{self.kind} '{name}' ({modules[name]}) cannot be imported: {error!r}") from error
        return self._only_class(module, name)

    def summary(self, name: str) -> str:
        """Return the first line of the docstring of a plug-in's file, without importing it."""
        specification = importlib.util.find_spec(self.modules()[name])
        if specification is None or specification.origin is None:
            return ""
        return (ast.get_docstring(ast.parse(Path(specification.origin).read_bytes())) or "").split("\n")[0]

    def add_file(self, path: str | Path) -> str:
        """Register the plug-in in a Python file and return its name, the file's stem."""
        file = Path(path)
        if not file.is_file():
            raise PluginError(f"{file}: no such {self.kind} file.")
        module_name = f"fdbench_file_plugins.{self.kind}.{file.stem}"
        specification = importlib.util.spec_from_file_location(module_name, file)
        if specification is None or specification.loader is None:
            raise PluginError(f"{file}: a plug-in file must end in .py.")
        module = importlib.util.module_from_spec(specification)
        sys.modules[module_name] = module
        try:
            specification.loader.exec_module(module)
        except Exception as error:
            raise PluginError(f"{file}: cannot be imported: {error!r}") from error
        self._files[file.stem] = self._only_class(module, file.stem)
        return file.stem

    def resolve(self, name_or_file: str) -> str:
        """Return a registered name; a path ending in ``.py`` is registered first."""
        return self.add_file(name_or_file) if name_or_file.endswith(".py") else name_or_file

    def _only_class(self, module: ModuleType, name: str) -> type[T]:
        classes = [
            value
            for value in vars(module).values()
            if inspect.isclass(value)
            and issubclass(value, self.base)
            and not inspect.isabstract(value)
            and value.__module__ == module.__name__
        ]
        if len(classes) != 1:
            raise PluginError(
                f"{module.__file__}: a plug-in file defines exactly one {self.base.__name__}, found "
                f"{[value.__name__ for value in classes] or 'none'}."
            )
        classes[0].name = name  # type: ignore[attr-defined]
        return classes[0]
