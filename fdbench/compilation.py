"""Machine code on disk that is never stale: it is kept under a digest of everything that a compiled function reaches.

numba keeps machine code by the file of the function alone, but a compiled function also freezes what it uses from
elsewhere: constants, arrays, other compiled functions. All of that is gathered here, by value, or refused.
"""

import builtins
import dis
import enum
import gc
import hashlib
import inspect
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import IO, Any, cast

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import types
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from fdbench.errors import PluginError

try:
    import fcntl
except ImportError:  # on Windows each process compiles for itself
    fcntl = None  # type: ignore[assignment]

INTERLEAVE = "-force-vector-interleave"  # of LLVM; 0: as it sees fit
UNROLLED = "-unroll-full-max-count"  # of LLVM: turns up to which a loop is written out, which then is no vector
MOST_UNROLLED, WITHOUT_END = 4, 2**32 - 1
LONGEST_WAIT_S, LOOK_AGAIN_S = 60.0, 0.02

FIXED = {"_operator", "builtins", "cmath", "math", "numba", "numpy", "operator"}
"""Packages whose content changes with their version alone."""

ALLOWED = (
    "A compiled function may use numbers, strings, tuples of them, enumerations, NumPy arrays, functions compiled by "
    "numba.njit, and modules with such content"
)
PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis))
NAMED = (type, FunctionType, BuiltinFunctionType, np.ufunc, type(np.sum))


def closure_digest(dispatcher: Any) -> str:
    """Return a digest of a compiled function and of all that it reaches: code, options, and constants by value.

    Functions that it reaches and that numba keeps on disk are from now on kept as by `kept`.

    Raises
    ------
    PluginError
        If it uses an object whose content cannot be told, such as a list, or a function from numba's stale cache.
    """
    digest = hashlib.sha256()
    for part in _Walk().dispatcher(dispatcher):
        digest.update(part.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def kept(dispatcher: Any) -> Any:
    """Keep the machine code of a function, compiled by ``njit`` without ``cache``, under its `closure_digest`.

    Of several processes that need the same, one compiles and the others wait for it.
    """
    if isinstance(dispatcher, Dispatcher) and not isinstance(cast(Any, dispatcher)._cache, _ClosureCache):
        cache, compile_here = _ClosureCache(dispatcher), dispatcher.compile

        def compile_once(signature: Any) -> Any:
            if signature in dispatcher.overloads:
                return compile_here(signature)
            with global_compiler_lock, cache.alone(signature), _uncollected():
                return compile_here(signature)

        cast(Any, dispatcher)._cache = cache
        cast(Any, dispatcher).compile = compile_once
    return dispatcher


def optimised(dispatcher: Any, level: int, interleaved: int = 0) -> Any:
    """Compile a function at a level of LLVM other than numba's 3, and with loops interleaved as often as told.

    A lower level suits long straight code better. A chain of divisions and polynomials that depend on each other waits
    for each; where vectors of several turns of a loop take theirs at once, they wait together. Short loops become
    vectors, too, instead of being written out lane by lane. No sum is reordered.
    """
    if isinstance(dispatcher, Dispatcher):
        compiler = cast(Any, dispatcher)._compiler
        compile_fully = compiler.compile

        def compile_so(arguments: Any, returned: Any) -> Any:
            config = cast(Any, numba.config)
            usual, config.OPT = config.OPT, type(config.OPT)(level)
            llvm.set_option("fdbench", f"{INTERLEAVE}={interleaved}")
            llvm.set_option("fdbench", f"{UNROLLED}={MOST_UNROLLED if interleaved else WITHOUT_END}")
            try:
                return compile_fully(arguments, returned)
            finally:
                config.OPT = usual
                llvm.set_option("fdbench", f"{INTERLEAVE}=0")
                llvm.set_option("fdbench", f"{UNROLLED}={WITHOUT_END}")

        compiler.compile = compile_so
    return dispatcher


def followed(dispatcher: Any) -> Any:
    """Refuse a function when it is compiled as `closure_digest` does; its own machine code is not kept on disk.

    Raises
    ------
    PluginError
        If numba is told not to compile.
    """
    if not isinstance(dispatcher, Dispatcher):
        raise PluginError("kernels have to be compiled. Unset NUMBA_DISABLE_JIT in the environment.")
    cast(Any, dispatcher)._cache = _NoCache(dispatcher)
    return dispatcher


class _NoCache(NullCache):
    """No machine code on disk, but a walk over what the function reaches before it is compiled."""

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher

    def load_overload(self, sig: Any, target_context: Any) -> None:
        closure_digest(self._dispatcher)


class _ClosureCache(FunctionCache):
    """numba's cache with the digest, as it is when something is compiled, in the names of its files."""

    def __init__(self, dispatcher: Any) -> None:
        super().__init__(dispatcher.py_func)
        self._dispatcher = dispatcher

    @contextmanager
    def alone(self, sig: Any) -> Iterator[None]:
        """Wait until no other process compiles for these types of arguments, unless that is done or takes too long."""
        self._follow(self._digest(sig))
        index = Path(self._cache_file._index_path)
        if fcntl is None or not isinstance(sig, tuple) or index.is_file():
            yield
            return
        with ExitStack() as stack:
            with suppress(OSError):  # who may not write here keeps nothing, and waits for nobody
                index.parent.mkdir(parents=True, exist_ok=True)
                file = stack.enter_context(index.with_suffix(".lock").open("wb"))
                deadline = time.monotonic() + LONGEST_WAIT_S
                while not (_is_locked(file) or index.is_file()) and time.monotonic() < deadline:
                    time.sleep(LOOK_AGAIN_S)
            yield

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        self._follow(self._digest(sig))
        return super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        self._follow(self._digest(sig))
        super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # numba's own key pickles a closure, in which a compiled function is another in every process.
        return sig, codegen.magic_tuple()

    def _digest(self, sig: Any) -> str:
        """Return the digest of function and types of arguments: what is kept of a named tuple names its class."""
        classes = [
            _origin(item.instance_class) for item in sig if isinstance(item, types.NamedTuple | types.NamedUniTuple)
        ]
        return hashlib.sha256(f"{closure_digest(self._dispatcher)} {sig} {classes}".encode()).hexdigest()

    def _follow(self, digest: str) -> None:
        name = f"{self._impl.filename_base}-{digest[:16]}"
        self._cache_file: Any = IndexDataCacheFile(self._cache_path, name, digest)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Look for no cycles of objects: to compile makes many that stay, and each search goes through all of them."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _is_locked(file: IO[bytes]) -> bool:
    """Lock a file for this process, unless another one has it, and return whether it is."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class _Walk:
    """One walk over all that a compiled function reaches, each function once."""

    def __init__(self) -> None:
        self.seen: list[int] = []
        self.where = ""

    def dispatcher(self, dispatcher: Any) -> Iterator[str]:
        """Yield a text of each part of a compiled function."""
        if id(dispatcher) in self.seen:
            yield f"function {self.seen.index(id(dispatcher))}"
            return
        self.seen.append(id(dispatcher))
        function, before = dispatcher.py_func, self.where
        self.where = f"{inspect.getfile(function)}, line {function.__code__.co_firstlineno}: {function.__qualname__}"
        if type(dispatcher._cache) is FunctionCache:
            if any(dispatcher.stats.cache_hits.values()):
                raise PluginError(
                    f"{self.where} was read from numba's cache, which does not see what it uses from other files. "
                    "Compile it without cache=True, or without a signature."
                )
            kept(dispatcher)
        yield repr(sorted((name, str(value)) for name, value in dispatcher.targetoptions.items()))
        yield from self._function(function)
        self.where = before

    def _function(self, function: FunctionType) -> Iterator[str]:
        code = function.__code__
        mentioned = _names(code)
        yield from _code(code)
        yield from self._value("its defaults", function.__defaults__)
        yield from self._value("its defaults", tuple(sorted((function.__kwdefaults__ or {}).items())))
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            yield from self._value(name, cell.cell_contents, mentioned)
        for name in sorted(_globals(code)):
            if name in function.__globals__:
                yield from self._value(name, function.__globals__[name], mentioned)
            elif hasattr(builtins, name):
                yield f"builtin {name}"

    def _value(self, name: str, value: Any, mentioned: frozenset[str] = frozenset()) -> Iterator[str]:
        """Yield the content of what a function calls ``name``; ``mentioned`` are all names in that function."""
        yield name
        if isinstance(value, Dispatcher):
            yield from self.dispatcher(value)
        elif isinstance(value, PLAIN) and type(value) in PLAIN:
            yield f"{type(value).__name__} {value!r}"
        elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            yield f"{type(value).__name__} {value.dtype.descr} {value.shape} {np.asarray(value).tobytes().hex()}"
        elif isinstance(value, tuple):
            yield f"{_origin(value)} {getattr(value, '_fields', '')} {len(value)}"
            for number, item in enumerate(value):
                yield from self._value(f"{name}[{number}]", item)
        elif isinstance(value, enum.Enum):
            yield from self._value(f"{name}.value", value.value)
        elif isinstance(value, enum.EnumMeta):
            yield _origin(value)
            members: Mapping[str, enum.Enum] = value.__members__
            for item, member in members.items():
                yield from self._value(f"{name}.{item}", member.value)
        elif isinstance(value, ModuleType):
            yield f"module {value.__name__}"
            if value.__name__.split(".")[0] not in FIXED:
                for item in sorted(mentioned & set(vars(value))):
                    yield from self._value(f"{name}.{item}", vars(value)[item], mentioned)
        elif _is_fixed(value):
            yield f"{_origin(value)} {getattr(value, '__name__', value)}"
        else:
            raise PluginError(
                f"{self.where} uses {name}, which is {_kind(value)}; machine code would not follow a change of it. "
                f"{ALLOWED}."
            )


def _code(code: CodeType) -> Iterator[str]:
    """Yield the instructions of a function and of those within it, without their lines and their file."""
    yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {code.co_freevars} {code.co_cellvars}"
    yield f"{code.co_argcount} {code.co_posonlyargcount} {code.co_kwonlyargcount} {code.co_flags}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        elif isinstance(constant, frozenset):
            yield f"frozenset {sorted(map(repr, constant))}"
        else:
            yield f"{type(constant).__name__} {constant!r}"


def _within(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function and of those within it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _within(constant)


def _names(code: CodeType) -> frozenset[str]:
    """Return the names of globals and of attributes in a function."""
    return frozenset(name for part in _within(code) for name in part.co_names)


def _globals(code: CodeType) -> frozenset[str]:
    """Return the names of globals in a function."""
    instructions = (instruction for part in _within(code) for instruction in dis.get_instructions(part))
    return frozenset(found.argval for found in instructions if found.opname in ("LOAD_GLOBAL", "LOAD_NAME"))


def _is_fixed(value: Any) -> bool:
    """Return whether an object is a function or a type of a package that changes with its version alone."""
    module = "numpy" if isinstance(value, np.ufunc) else str(getattr(value, "__module__", None))
    return isinstance(value, types.Type) or (isinstance(value, NAMED) and module.split(".")[0] in FIXED)


def _origin(value: Any) -> str:
    """Return the place of a type or function, or of an object's type, with the versions of what may hold it."""
    owner = value if isinstance(value, type | FunctionType | BuiltinFunctionType) else type(value)
    return f"{owner.__module__}.{owner.__qualname__} {numba.__version__} {np.__version__}"


def _kind(value: Any) -> str:
    """Return what an object is, in words."""
    if isinstance(value, FunctionType):
        return f"the plain Python function {value.__qualname__}"
    if isinstance(value, type):
        return f"the class {value.__qualname__}"
    return f"of type {type(value).__name__}"
