"""Plug-ins by name and by file: what is found, what is refused, and in which words."""

import pickle
import subprocess
import sys
from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

import pytest

from fdbench import registry as module
from fdbench.errors import PluginError, UnknownName, did_you_mean
from fdbench.estimator import Estimator, estimators
from fdbench.registry import Registry, add_file


class Tool(ABC):
    """Base of the plug-ins of these tests, found under the name of this module."""

    name: ClassVar[str]
    unit: ClassVar[str]

    @abstractmethod
    def use(self) -> int:
        """Return a number."""


HEAD = f"from {__name__} import Tool\n"
GOOD = HEAD + "class Hammer(Tool):\n    unit = 'm'\n    def use(self):\n        return 1\n"


@pytest.fixture
def tools() -> Registry[Tool]:
    return Registry("tool", Tool)


def write(folder: Path, text: str, name: str = "hammer.py") -> Path:
    file = folder / name
    file.write_text(text, "utf-8")
    return file


def test_a_file_is_registered_under_its_stem(tools: Registry[Tool], tmp_path: Path) -> None:
    assert tools.resolve(str(write(tmp_path, '"""Drives nails."""\n' + GOOD, "großer hammer.py"))) == "großer hammer"
    assert tools.names() == ["großer hammer"]
    assert tools.get("großer hammer").name == "großer hammer"
    assert tools.get("großer hammer")().use() == 1
    assert tools.summary("großer hammer") == "Drives nails."
    assert tools.resolve("saw") == "saw"


@pytest.mark.parametrize("stem", ["hammer", "ham.mer", "ham-mer"])
def test_instances_of_a_file_can_be_pickled(tools: Registry[Tool], tmp_path: Path, stem: str) -> None:
    tools.add_file(write(tmp_path, GOOD, f"{stem}.py"))
    assert pickle.loads(pickle.dumps(tools.get(stem)())).use() == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import nothing_of_this_name\n", r"line 1: ModuleNotFoundError: No module named 'nothing_of_this_name'"),
        ("x = 1\ndef f(:\n", r"line 2: SyntaxError: invalid syntax"),
        ("x = 1\n\n1 / 0\n", r"line 3: ZeroDivisionError: division by zero"),
        ("import sys\nsys.exit(3)\n", r"line 2: SystemExit: 3"),
        ("x = '\0'\n", r"cannot be imported: (SyntaxError|ValueError): .*null bytes"),
        ("", r"exactly one Tool, found no class derived from it"),
        (HEAD, r"found no class derived from it"),
        (HEAD + "class Saw(Tool):\n    unit = 'm'\n", r"found Saw, which lacks use"),
        (GOOD + "class Saw(Hammer):\n    pass\n", r"exactly one Tool, found Hammer, Saw"),
        (GOOD.replace("    unit = 'm'\n", ""), r"Hammer lacks the class attribute unit"),
    ],
)
def test_a_faulty_file_is_told_what_is_wrong(tools: Registry[Tool], tmp_path: Path, text: str, message: str) -> None:
    file = write(tmp_path, text)
    before = set(sys.modules)
    with pytest.raises(PluginError, match=message) as caught:
        tools.add_file(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert tools.names() == []
    assert "cannot be imported" not in str(caught.value) or set(sys.modules) == before


def test_a_missing_file_names_its_neighbour(tools: Registry[Tool], tmp_path: Path) -> None:
    write(tmp_path, GOOD)
    (tmp_path / "folder.py").mkdir()
    for name, message in (
        ("hamer.py", r"no such file\. Did you mean hammer\.py\?"),
        ("folder.py", "a folder, not a plug-in file"),
        ("nowhere/hammer.py", r"no such file\.$"),
    ):
        with pytest.raises(PluginError, match=message):
            tools.add_file(tmp_path / name)
    with pytest.raises(PluginError, match=r"must end in \.py"):
        tools.add_file(write(tmp_path, GOOD, "hammer.txt"))
    assert not (tmp_path / "__pycache__").exists()


def test_a_second_name_of_a_class_does_not_count_twice(tools: Registry[Tool], tmp_path: Path) -> None:
    tools.add_file(write(tmp_path, GOOD + "Mallet = Hammer\n"))
    assert tools.get("hammer").__name__ == "Hammer"


def test_a_file_edited_at_once_is_read_anew(tools: Registry[Tool], tmp_path: Path) -> None:
    for number in (1, 2, 3):
        tools.add_file(write(tmp_path, GOOD.replace("return 1", f"return {number}")))
        assert tools.get("hammer")().use() == number
    with pytest.raises(PluginError, match="SyntaxError"):
        tools.add_file(write(tmp_path, "("))
    assert pickle.loads(pickle.dumps(tools.get("hammer")())).use() == 3


def test_what_a_file_prints_stays_out_of_the_output(
    tools: Registry[Tool], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tools.add_file(write(tmp_path, "print('hello')\n" + GOOD))
    assert capsys.readouterr() == ("", "hello\n")


def test_the_kind_of_a_file_is_found(tmp_path: Path) -> None:
    tools, numbers = Registry("tool", Tool), Registry("number", int)
    assert add_file(write(tmp_path, GOOD), (numbers, tools)) == "hammer"
    assert (tools.names(), numbers.names()) == (["hammer"], [])
    with pytest.raises(PluginError, match="derived from int or Tool, found none"):
        add_file(write(tmp_path, "", "saw.py"), (numbers, tools))


def test_a_name_that_is_taken_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, GOOD, "null.py")
    with pytest.raises(PluginError, match=r"the name null belongs to the estimator fdbench_baselines\.null\. Rename"):
        estimators.add_file(file)


def test_the_own_file_of_a_package_is_that_plugin() -> None:
    own = Path(sys.modules[estimators.get("null").__module__].__file__ or "")
    before = dict(estimators._files)
    assert estimators.add_file(own) == "null"
    assert estimators._files == before


def test_an_unknown_name_is_answered_with_the_nearest(
    tools: Registry[Tool], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tools.add_file(write(tmp_path, GOOD))
    with pytest.raises(UnknownName, match=r"unknown tool 'Hamer'\. Did you mean hammer\?$"):
        tools.get("Hamer")
    monkeypatch.chdir(tmp_path)
    write(tmp_path, GOOD, "saw.py")
    with pytest.raises(UnknownName, match=r"A file is given as saw\.py\."):
        tools.get("saw")


def test_a_package_that_is_not_there_is_named(tools: Registry[Tool], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("nothing_of_this_name", "nothing_of_this_name.tools", "fdbench.errors"):
        monkeypatch.setattr(module, "_packages", lambda group, name=name: (name,))
        with pytest.raises(PluginError, match=f"tool package '{name}'"):
            tools.names()


def test_a_broken_file_in_a_package_is_listed_and_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "some_tools"
    package.mkdir()
    write(package, "", "__init__.py")
    write(package, '"""Splits wood."""\nimport nothing_of_this_name\n', "axe.py")
    write(package, "def f(:\n", "saw.py")
    write(package, GOOD, "_private.py")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(module, "_packages", lambda group: ("some_tools",))
    tools = Registry("tool", Tool)
    assert tools.modules() == {"axe": "some_tools.axe", "saw": "some_tools.saw"}
    assert tools.summary("axe") == "Splits wood."
    assert tools.summary("saw") == "cannot be read: SyntaxError: invalid syntax (<unknown>, line 1)"
    with pytest.raises(PluginError, match=r"tool 'axe' \(some_tools\.axe\) cannot be imported: line 2: ModuleNotFound"):
        tools.get("axe")


def test_listing_imports_no_plugin() -> None:
    program = """
        import sys
        from fdbench.registry import Registry
        for kind in ("estimator", "effect", "metric", "plant", "motion"):
            registry = Registry(kind, object)
            assert registry.names() and all(registry.summary(name).endswith(".") for name in registry.names()), kind
        print(*{"fdbench.effects", "fdbench.plants", "fdbench_baselines.null", "numba"} & set(sys.modules))
    """
    text = "\n".join(line.removeprefix("        ") for line in program.splitlines())
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=120, check=False)
    assert (done.stdout, done.stderr) == ("\n", "")


def test_every_registered_estimator_is_found() -> None:
    names = estimators.names()
    assert {"null", "least_squares", "pl_lssvm", "krls_t"} <= set(names)
    assert all(issubclass(estimators.get(name), Estimator) and estimators.get(name).name == name for name in names)


@pytest.mark.parametrize(
    ("name", "allowed", "answer"),
    [
        ("mas_kg", ["mass_kg", "lead_m"], " Did you mean mass_kg?"),
        ("KRLS-T", ["krls_t", "kalman"], " Did you mean krls_t?"),
        ("lugre", ["lugre_friction", "backlash"], " Did you mean lugre_friction?"),
        ("N", ["N", "n"], " Did you mean N?"),
        ("q", ["b", "a", "b"], " Allowed: a, b."),
        ("", ["a"], " Allowed: a."),
        ("a", [], " Allowed: none."),
    ],
)
def test_did_you_mean(name: str, allowed: list[str], answer: str) -> None:
    assert did_you_mean(name, allowed) == answer


def test_a_long_list_is_cut_to_the_nearest() -> None:
    answer = did_you_mean("xyz", [*(f"name_{number}" for number in range(70)), "xabcdefg", "xabcdefg"])
    assert answer.startswith(" Nearest of the 71 that are allowed: xabcdefg, name_")
    assert answer.count(",") == 4
