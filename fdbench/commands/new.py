"""``fdbench new``: the templates are the folders of ``fdbench/templates``, one for each kind.

Where the name comes, the text and the path of a file there have ``my_plugin`` and ``MyPlugin``; its ``.txt`` goes.
"""

import keyword
import re
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._say import say, typed
from fdbench.errors import FdbenchError, UnknownName, did_you_mean

NAME, CLASS = "my_plugin", "MyPlugin"

REFERENCE_ROW = "oracle"


def new(
    kind: Annotated[
        str,
        typer.Argument(
            autocompletion=lambda: kinds(), help="What to write: estimator, effect, scenario, diagnoser or package."
        ),
    ],
    name: Annotated[str, typer.Argument(help="Its name: my_estimator, or MyScenario.")],
    folder: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")] = Path(),
) -> None:
    """Write a small plug-in of your own that works, to change: an estimator, effect, scenario, diagnoser or package."""
    from fdbench.files import write_text

    texts = {folder / path: text for path, text in written(kind, name).items()}
    for path in texts:
        if path.exists():
            raise FdbenchError(f"{path}: is there already, and nothing is overwritten. Give another name or folder.")
    for path, text in texts.items():
        write_text(path, text, folders=True)
    say(f"Written: {', '.join(map(str, texts))}")
    plugin = next(path for path in texts if path.stem.removesuffix("-v0") == name.removesuffix("-v0"))
    say(f"Next: fdbench check {typed(plugin)}")


def kinds() -> list[str]:
    """Return the kinds of which there is a template."""
    return sorted(folder.name for folder in files("fdbench").joinpath("templates").iterdir())


def written(kind: str, name: str) -> dict[Path, str]:
    """Return the files of a new plug-in, by their paths in its folder.

    >>> [str(path) for path in written("estimator", "ridge")]
    ['ridge.py']

    Raises
    ------
    UnknownName
        If there is no such kind.
    FdbenchError
        If the name is none, or is taken.
    """
    if kind not in kinds():
        raise UnknownName(f"kind '{kind}'.{did_you_mean(kind, kinds())}")
    templates = dict(_files(files("fdbench").joinpath("templates", kind), Path()))
    is_camel = any(CLASS in str(path) for path in templates)
    snake, camel = _both(name.removesuffix("-v0") if is_camel else name, is_camel=is_camel)
    _check_free(camel if is_camel else snake)

    def filled(text: str) -> str:
        return text.replace(NAME, snake).replace(CLASS, camel)

    return {Path(filled(str(path))).with_suffix(""): filled(text) for path, text in templates.items()}


def _files(folder: Traversable, place: Path) -> Iterator[tuple[Path, str]]:
    """Yield path and text of each file below a folder."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            yield from _files(entry, place / entry.name)
        else:
            yield place / entry.name, entry.read_text("utf-8")


def _both(name: str, *, is_camel: bool) -> tuple[str, str]:
    """Return a name as that of a file and as that of a class; one that cannot be both is refused."""
    words = re.findall(r"[A-Za-z][a-z0-9]*|[0-9]+", re.sub(r"[^A-Za-z0-9]+", "_", name)) or ["my", "own"]
    snake, camel = "_".join(words).lower(), "".join(word[:1].upper() + word[1:] for word in words)
    form = r"[A-Z][A-Za-z0-9]*" if is_camel else r"[a-z][a-z0-9_]*"
    if not re.fullmatch(form, name) or keyword.iskeyword(name):
        wanted = "letters and digits, a capital first" if is_camel else "small letters, digits and _, a letter first"
        meant = camel if is_camel else snake
        reason = "is a word of Python" if keyword.iskeyword(name) else f"is no name: {wanted}, are expected"
        hint = f" Did you mean {meant}?" if not keyword.iskeyword(meant) and re.fullmatch(form, meant) else ""
        raise FdbenchError(f"name '{name}' {reason}.{hint}")
    return (snake, name) if is_camel else (name, camel)


def _check_free(name: str) -> None:
    """Refuse a name that a plug-in of any kind, a package of plug-ins or a scenario has."""
    from fdbench.catalogue import scenario_ids
    from fdbench.commands.list import Listed
    from fdbench.registry import Registry

    taken = {identifier.rpartition("-v")[0]: f"scenario {identifier}" for identifier in scenario_ids()}
    taken |= {REFERENCE_ROW: "row of the truth"}
    for kind in (each.value.removesuffix("s") for each in Listed):
        registry: Registry[object] = Registry(kind, object)
        taken |= {package.removeprefix("fdbench_"): f"package {package}" for package in registry.packages()}
        taken |= {plugin: f"{kind} {module}" for plugin, module in registry.modules().items()}
    if name in taken:
        raise FdbenchError(f"name '{name}' belongs to the {taken[name]}. Choose another.")
