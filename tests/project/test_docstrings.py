"""Every public module, class, function and method says what it is; an override inherits its docstring."""

import importlib
import pkgutil
from types import FunctionType, MethodType, ModuleType

import fdbench_baselines
import pytest

import fdbench

PACKAGES = (fdbench, fdbench_baselines)
MODULES = sorted(
    {package.__name__ for package in PACKAGES}
    | {
        module.name
        for package in PACKAGES
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".")
        if not module.name.rsplit(".", 1)[1].startswith("_")
    }
)


def public(owner: ModuleType | type) -> dict[str, object]:
    """Return the public names that a module or class has itself."""
    return {name: getattr(owner, name) for name in vars(owner) if not name.startswith("_")}


def undocumented(module: ModuleType) -> list[str]:
    """Return the public names without a docstring; compiled kernels are described where the class is."""
    own = {name: thing for name, thing in public(module).items() if getattr(thing, "__module__", "") == module.__name__}
    missing = [] if module.__doc__ else ["the module"]
    for name, thing in own.items():
        if isinstance(thing, FunctionType | type) and not thing.__doc__:
            missing.append(name)
        if isinstance(thing, type):
            missing += [
                f"{name}.{member}"
                for member, value in public(thing).items()
                if isinstance(value, FunctionType | MethodType | property)
                and not any(getattr(vars(base).get(member), "__doc__", None) for base in thing.__mro__)
            ]
    return missing


@pytest.mark.parametrize("name", MODULES)
def test_public_names_have_docstrings(name: str) -> None:
    assert undocumented(importlib.import_module(name)) == []


def test_missing_docstrings_are_found() -> None:
    class Base:
        """Documented."""

        def inherits(self) -> None:
            """Documented."""

    class Thing(Base):
        value = property(lambda self: 1)

        def inherits(self) -> None: ...

        @classmethod
        def make(cls) -> None: ...

    module = ModuleType("module")
    for thing in (Base, Thing):
        thing.__module__ = "module"
        setattr(module, thing.__name__, thing)
    assert undocumented(module) == ["the module", "Thing", "Thing.value", "Thing.make"]
