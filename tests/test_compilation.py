"""No stale machine code: whatever a compiled function uses, a new process sees its edit, or the function is refused."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from fdbench.compilation import closure_digest, followed, kept
from fdbench.errors import PluginError

BEFORE, AFTER = "2.0", "3.5"


class Kind(NamedTuple):
    """How a function comes by a value: what its file says, how the function uses it, and a file beside it."""

    header: str
    use: str
    beside: str = ""


FOLLOWED = {
    "int": Kind("G = int(2 * VALUE)", "0.5 * G"),
    "float": Kind("G = VALUE", "G"),
    "bool": Kind("G = VALUE > 3.0", "(3.5 if G else 2.0)"),
    "str": Kind("G = 'a' if VALUE < 3.0 else 'b'", "(2.0 if G == 'a' else 3.5)"),
    "tuple": Kind("G = (1.0, VALUE)", "G[1]"),
    "nested_tuple": Kind("G = (1.0, (2, (VALUE, 3.0)))", "G[1][1][0]"),
    "named_tuple": Kind(
        "from typing import NamedTuple\nclass Pair(NamedTuple):\n    a: float\n    b: float\nG = Pair(1.0, VALUE)",
        "G.b",
    ),
    "enumeration": Kind(
        "import enum\nclass G(enum.IntEnum):\n    A = int(2 * VALUE)\n    B = 4", "(2.0 if G.A == G.B else 3.5)"
    ),
    "array": Kind("import numpy as np\nG = np.array([1.0, VALUE])", "G[1]"),
    "scalar_of_numpy": Kind("import numpy as np\nG = np.float32(VALUE)", "G"),
    "function": Kind("@njit\ndef g():\n    return VALUE\n", "g()"),
    "function_kept_by_numba": Kind("@njit(cache=True)\ndef g():\n    return VALUE\n", "g()"),
    "function_of_a_constant": Kind(
        "G = VALUE\n@njit\ndef f():\n    return G\n@njit\ndef g():\n    return f()\n", "g()"
    ),
    "function_beside": Kind(
        "from NAME_beside import g", "g()", "from numba import njit\n@njit\ndef g():\n    return VALUE\n"
    ),
    "cached_function_of_a_constant_beside": Kind(
        "from NAME_beside import G\n@njit(cache=True)\ndef g():\n    return G\n", "g()", "G = VALUE"
    ),
    "constant_beside": Kind("from NAME_beside import G", "G", "G = VALUE"),
    "tuple_beside": Kind("from NAME_beside import G", "G[0]", "G = (VALUE, 1)"),
    "attribute_of_a_module": Kind("import NAME_beside as constants", "constants.G", "G = VALUE"),
    "function_of_a_module": Kind(
        "import NAME_beside as other", "other.g()", "from numba import njit\n@njit\ndef g():\n    return VALUE\n"
    ),
    "default": Kind("@njit\ndef g(a=VALUE):\n    return a\n", "g()"),
    "closure": Kind("def make(G):\n    @njit\n    def g():\n        return G\n    return g\ng = make(VALUE)", "g()"),
    "inner_function": Kind(
        "G = VALUE\n@njit\ndef g():\n    def inner():\n        return G\n    return inner()\n", "g()"
    ),
}
REFUSED = {
    "list": Kind("G = [VALUE]", "G[0]"),
    "dictionary": Kind("G = {1: VALUE}", "G[1]"),
    "set": Kind("G = {VALUE}", "len(G)"),
    "attribute_of_a_class": Kind("class G:\n    value = VALUE", "G.value"),
    "attribute_of_an_object": Kind("from types import SimpleNamespace\nG = SimpleNamespace(value=VALUE)", "G.value"),
    "list_in_a_tuple": Kind("G = (1.0, [VALUE])", "G[1][0]"),
    "list_in_a_module": Kind("import NAME_beside as constants", "constants.G[0]", "G = [VALUE]"),
    "plain_function": Kind("def g():\n    return VALUE", "g()"),
}
KEPT = """
from numba import njit
from fdbench.compilation import kept
{header}

@kept
@njit(error_model="numpy")
def value(t):
    return t * {use}
"""
EFFECT = """
from dataclasses import dataclass
from typing import final
from numba import njit
from fdbench.effects import Effect, Port, kernel, parameter
{header}

@final
@dataclass(frozen=True, kw_only=True)
class Mine(Effect):
    port = Port.TABLE_FORCE
    amplitude = "force_N"
    force_N: float = parameter("F", low=0.0, high=1.0, typical=1.0)

    @kernel
    def kernel(t, h, x, v, u, F):
        return F * {use}, 0.0
"""
RUN = r"""
import importlib, json, sys
from pathlib import Path
from fdbench.effects import effects
from fdbench.errors import PluginError
from fdbench.simulate.compose import load
folder, names = Path(sys.argv[1]), sys.argv[2:]
sys.path.insert(0, str(folder))
stepper = "from numba import njit\nkernel = KERNELS[0]\n@njit(cache=True)\n"
stepper += "def advance(F):\n    return kernel(0.0, 0.0, 0.0, 0.0, 0.0, F)[0]\n"
values, messages, compiled = {}, {}, {}
for name in names:
    try:
        if (folder / "kept").is_file():
            value = importlib.import_module(name).value
        else:
            value = load(stepper, [effects.get(effects.add_file(folder / f"{name}.py")).kernel]).advance
        values[name] = float(value(1.0))
        if not any(value.stats.cache_hits.values()):
            compiled[name] = True
    except PluginError as error:
        messages[name] = str(error)
print(json.dumps([values, messages, compiled]))
"""


def write(folder: Path, form: str, value: str) -> None:
    """Write a file for each kind of value, and those beside them."""
    for name, kind in (FOLLOWED | REFUSED).items():
        for file, text in ((name, form.format(header=kind.header, use=kind.use)), (f"{name}_beside", kind.beside)):
            if text:
                text = text.replace("VALUE", value).replace("NAME", f"a_{name}")
                (folder / f"a_{file}.py").write_text(text, "utf-8")


def run(folder: Path, **environment: str) -> tuple[dict[str, float], dict[str, str], set[str]]:
    """Return values and messages that a new process finds, by kind, and what it compiled anew."""
    variables = {"FDBENCH_CACHE": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    names = [f"a_{name}" for name in (FOLLOWED | REFUSED)]
    command = [sys.executable, "-c", RUN, str(folder), *names]
    done = subprocess.run(
        command, env=os.environ | variables | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    values, messages, compiled = (
        {name.removeprefix("a_"): item for name, item in part.items()} for part in json.loads(done.stdout)
    )
    return values, messages, set(compiled)


@pytest.mark.parametrize("form", ["kept", "effect"])
def test_an_edit_of_anything_that_a_function_uses_is_seen(tmp_path: Path, form: str) -> None:
    if form == "kept":
        (tmp_path / "kept").touch()
    text = KEPT if form == "kept" else EFFECT
    write(tmp_path, text, BEFORE)
    values, messages, _ = run(tmp_path)
    assert values == dict.fromkeys(FOLLOWED, float(BEFORE))
    assert run(tmp_path) == (values, messages, set())
    write(tmp_path, text, AFTER)
    edited, again, _ = run(tmp_path)
    assert edited == dict.fromkeys(FOLLOWED, float(AFTER))
    assert list(again) == list(messages) == list(REFUSED)
    for name, message in messages.items():
        assert f"a_{name}.py, line" in message, "where"
        assert " uses " in message, "what"
        assert "may use numbers, strings, tuples" in message, "what is allowed"
    # Another processor has its own entry in the same folder.
    other, _, compiled = run(
        tmp_path, NUMBA_CPU_NAME="nehalem" if os.environ.get("NUMBA_CPU_NAME") == "generic" else "generic"
    )
    assert (other, "float" in compiled) == (edited, True)
    assert run(tmp_path) == (edited, messages, set())


def test_a_value_is_told_from_one_that_equals_it() -> None:
    def digest(value: object) -> str:
        return closure_digest(njit(lambda: value))

    values = (
        1,
        1.0,
        True,
        "1",
        (1,),
        (1.0,),
        ((1,),),
        0.0,
        -0.0,
        None,
        np.float64(1.0),
        np.array([1.0]),
        np.array([1]),
    )
    values = (*values, np.array([[1.0]]), (1, 1), (1, (1,)), "", b"", ())
    assert len({digest(value) for value in values}) == len(values)
    assert digest((1.0, "a")) == digest((1.0, "a"))


def test_options_and_code_are_followed_and_place_is_not() -> None:
    G = 2.0
    plain, same, other = njit(lambda x: G * x), njit(lambda x: G * x), njit(lambda x: G + x)
    quick = njit(fastmath=True)(plain.py_func)
    digests = [closure_digest(item) for item in (plain, same, other, quick)]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


def test_functions_that_call_each_other_are_walked_once() -> None:
    @njit
    def even(n: int) -> bool:
        return n == 0 or odd(n - 1)

    @njit
    def odd(n: int) -> bool:
        return n != 0 and even(n - 1)

    assert closure_digest(even) != closure_digest(odd)


def test_a_refused_function_is_not_compiled() -> None:
    held = [1.0]
    for decorator in (kept, followed):
        with pytest.raises(PluginError, match=r"test_compilation.py, line \d+: .* uses held, which is of type list;"):
            decorator(njit(lambda: held[0]))()


def test_no_function_is_left_to_the_cache_of_numba() -> None:
    """One file stands apart from the package by intent; what its functions use, they have from that file alone."""
    from fdbench.virtual_axes import independent_simulator as independent_simulator

    repository = Path(__file__).resolve().parents[1]
    sources = [path for root in ("fdbench", "baselines") for path in (repository / root).rglob("*.py")]
    named = {path.stem for path in sources if "cache=True" in path.read_text("utf-8")}
    assert named == {"independent_simulator", "compilation"}
    imports = [
        line for line in Path(independent_simulator.__file__).read_text("utf-8").splitlines() if "import " in line
    ]
    assert not [line for line in imports if "fdbench" in line and line.startswith(("import", "from"))]


RENAMED = r"""
import sys
from typing import NamedTuple
from numba import njit
from fdbench.compilation import kept
class NAME(NamedTuple):
    a: float
@kept
@njit
def value(given):
    return 2.0 * given.a
assert value(NAME(1.5)) == 3.0
print(sum(value.stats.cache_hits.values()))
"""


def test_a_renamed_class_of_an_argument_is_compiled_anew(tmp_path: Path) -> None:
    """What numba keeps names the classes of arguments, and cannot be read once they are gone."""
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    hits = []
    for name in ("Noise", "Noise", "Variances", "Variances"):
        (tmp_path / "renamed.py").write_text(RENAMED.replace("NAME", name), "utf-8")
        command = [sys.executable, "-c", "import renamed"]
        done = subprocess.run(command, env=os.environ | variables, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        hits.append(int(done.stdout))
    assert hits == [0, 1, 0, 1]


ONCE = r"""
import time
import numpy as np
from numba import njit
from fdbench.compilation import kept
@kept
@njit
def value(given):
    return np.median(np.sort(given)) + np.argsort(given)[0]
time.sleep(max(0.0, START - time.time()))
assert value(np.array([1.0, 2.0, 3.0])) == 2.0
print(sum(value.stats.cache_misses.values()))
"""


def test_of_processes_that_need_the_same_one_compiles(tmp_path: Path) -> None:
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    (tmp_path / "once.py").write_text(ONCE.replace("START", str(time.time() + 5.0)), "utf-8")
    command = [sys.executable, "-c", "import once"]
    begun = [subprocess.Popen(command, env=os.environ | variables, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    assert sorted(process.communicate()[0].strip() for process in begun) == ["0", "0", "1"]
