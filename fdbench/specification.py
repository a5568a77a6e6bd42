"""Frozen specifications read strictly from TOML tables: the dataclass is the schema.

Unknown key, missing key, wrong type and out of bounds are errors at load, and name file, path, unit and nearest key.
"""

import dataclasses
import functools
import math
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from fdbench.documents import LARGEST_TOML, read_file, toml_tables
from fdbench.errors import FdbenchError, SpecError, did_you_mean
from fdbench.registry import Registry
from fdbench.units import unit_of

T = TypeVar("T")

LONGEST_VALUE = 60

_REGISTRIES: list[Registry[Any]] = []


def reads_plugins_of(registry: Registry[Any]) -> None:
    """Let fields annotated with the registry's base class be read by the ``kind`` key of their table."""
    _REGISTRIES.append(registry)


def bounded(low: float, high: float, *, default: Any = dataclasses.MISSING) -> Any:
    """Declare a number within the closed interval [low, high]."""
    return dataclasses.field(default=default, metadata={"low": low, "high": high})


def positive(*, default: Any = dataclasses.MISSING) -> Any:
    """Declare a number above zero."""
    return bounded(5e-324, math.inf, default=default)


def nonnegative(*, default: Any = dataclasses.MISSING) -> Any:
    """Declare a number of at least zero."""
    return bounded(0.0, math.inf, default=default)


def _interval(low: float, high: float) -> str:
    left = "(0" if low == 5e-324 else "(-inf" if low == -math.inf else f"[{low:g}"
    return f"{left}, {'inf)' if high == math.inf else f'{high:g}]'}"


def check_bounds(specification: Any) -> None:
    """Raise a SpecError if a number of a dataclass is not finite or lies outside its declared bounds."""
    kind: type = type(specification)
    for name, (low, high) in declared_bounds(kind).items():
        value = getattr(specification, name)
        if not isinstance(value, int | float) or isinstance(value, bool):
            continue
        if not (low <= value <= high and abs(value) < math.inf):
            unit = f" {unit_of(name)}" if unit_of(name) else ""
            raise SpecError(f"{name}: {_short(value)} is outside {_interval(low, high)}{unit}.")


@functools.cache
def declared_bounds(kind: type) -> Mapping[str, tuple[float, float]]:
    """Return the closed interval of each field of a dataclass that declares one, by its name."""
    fields = [field for field in dataclasses.fields(kind) if "low" in field.metadata]
    return {field.name: (field.metadata["low"], field.metadata["high"]) for field in fields}


def _short(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def snake_case(name: str) -> str:
    """Return ``VelocityLoop`` as ``velocity_loop``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def load_toml(path: str | Path) -> dict[str, Any]:
    """Return the tables of a TOML file; syntax errors name file and line."""
    file = Path(path)
    try:
        return toml_tables(read_file(file, LARGEST_TOML))
    except ValueError as error:
        raise SpecError(f"{file}: not valid TOML: {error}.") from error
    except FileNotFoundError as error:
        beside = [other.name for other in file.parent.glob("*.toml")]
        raise SpecError(
            f"{file}: cannot be read: no such file.{did_you_mean(file.name, beside) if beside else ''}"
        ) from error
    except OSError as error:
        raise SpecError(f"{file}: cannot be read: {error.strerror}.") from error


def read(cls: type[T], table: Any, where: str) -> T:
    """Return the dataclass ``cls`` filled from a TOML table.

    Parameters
    ----------
    cls : type
        A dataclass; nested dataclasses, tuples of them, unions told apart by ``kind``, and plug-ins are followed.
    table : mapping
        Parsed TOML.
    where : str
        File and path for messages, such as ``axis-v0.toml: plant``.

    Raises
    ------
    SpecError
        At the first key that is unknown, missing, of a wrong type or out of bounds.
    """
    if not isinstance(table, Mapping):
        raise SpecError(f"{where}: a table is expected, found {_describe(table)}.")
    hints, fields = _schema(typing.cast(Any, cls))
    for key in table:
        if key not in fields:
            nearest = did_you_mean(key, fields)
            unit = next((f" [{unit_of(name)}]" for name in fields if f"mean {name}?" in nearest and unit_of(name)), "")
            raise SpecError(
                f"{where}.{key}: unknown key for {snake_case(cls.__name__)}.{nearest[:-1]}{unit}{nearest[-1]}"
            )
    values: dict[str, Any] = {}
    for name, field in fields.items():
        if name in table:
            values[name] = convert(hints[name], table[name], f"{where}.{name}")
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            unit = f" [{unit_of(name)}]" if unit_of(name) else ""
            raise SpecError(f"{where}.{name}: missing key{unit} of {snake_case(cls.__name__)}.")
    try:
        return cls(**values)
    except FdbenchError as error:
        raise SpecError(f"{where}.{error}") from error
    except ArithmeticError as error:
        raise SpecError(f"{where}: these values cannot be computed with: {error}.") from error


@functools.lru_cache(maxsize=256)
def _schema(cls: type[Any]) -> tuple[dict[str, Any], dict[str, "dataclasses.Field[Any]"]]:
    """Return the types and the fields that a table may give a dataclass."""
    return typing.get_type_hints(cls), {field.name: field for field in dataclasses.fields(cls) if field.init}


def convert(hint: Any, value: Any, where: str) -> Any:
    """Return a TOML value as the annotated type."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        options = [option for option in typing.get_args(hint) if option is not type(None)]
        if value is None and len(options) < len(typing.get_args(hint)):
            return None
        return convert(options[0], value, where) if len(options) == 1 else _by_name(options, value, where)
    if origin is tuple:
        return _tuple(typing.get_args(hint), value, where)
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(value, Mapping):
            raise SpecError(f"{where}: a table is expected, found {_describe(value)}.")
        inner = typing.get_args(hint)[1]
        return {key: convert(inner, item, f"{where}.{key}") for key, item in value.items()}
    if hint is Any:
        return value
    for registry in _REGISTRIES:
        if hint is registry.base:
            return _by_kind(registry.get, value, where, registry.names)
    if dataclasses.is_dataclass(hint):
        return read(hint, value, where)  # type: ignore[arg-type]
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        if not abs(value) <= sys.float_info.max:
            raise SpecError(f"{where}: a finite number{_in_unit(where)} is expected, found {_describe(value)}.")
        return float(value)
    if isinstance(hint, type) and isinstance(value, hint) and (hint is bool or not isinstance(value, bool)):
        return value
    raise SpecError(
        f"{where}: {_TYPE_NAMES.get(hint, str(hint))}{_in_unit(where)} is expected, found {_describe(value)}."
    )


def _in_unit(where: str) -> str:
    unit = unit_of(where.rpartition(".")[2].partition("[")[0])
    return f" in {unit}" if unit else ""


_TYPE_NAMES = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


def _describe(value: Any) -> str:
    name = {bool: "true or false:", dict: "a table", list: "a list", str: "the text"}.get(type(value), "")
    return name if isinstance(value, dict | list) else f"{name} {_shortened(repr(value))}".strip()


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}..."


def _tuple(inner: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise SpecError(f"{where}: a list is expected, found {_describe(value)}.")
    if inner[-1] is Ellipsis:
        return tuple(convert(inner[0], item, f"{where}[{index}]") for index, item in enumerate(value))
    if len(inner) != len(value):
        raise SpecError(f"{where}: {len(inner)} values are expected, found {len(value)}.")
    return tuple(convert(hint, item, f"{where}[{i}]") for i, (hint, item) in enumerate(zip(inner, value, strict=True)))


def _by_name(options: list[Any], value: Any, where: str) -> Any:
    by_name = {snake_case(option.__name__): option for option in options}

    def find(kind: str) -> Any:
        if kind not in by_name:
            raise SpecError(f"unknown kind '{kind}'.{did_you_mean(kind, by_name)}")
        return by_name[kind]

    return _by_kind(find, value, where, lambda: by_name)


def _by_kind(find: Callable[[str], Any], value: Any, where: str, names: Callable[[], Iterable[str]]) -> Any:
    if not isinstance(value, Mapping):
        raise SpecError(f"{where}: a table is expected, found {_describe(value)}.")
    if "kind" not in value:
        raise SpecError(f"{where}.kind: missing key.{did_you_mean('', names())}")
    kind = convert(str, value["kind"], f"{where}.kind")
    try:
        cls = find(kind)
    except FdbenchError as error:
        raise SpecError(f"{where}.kind: {error}") from error
    return read(cls, {key: item for key, item in value.items() if key != "kind"}, where)
