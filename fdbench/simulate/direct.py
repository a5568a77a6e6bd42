"""Compiled steppers without what numba does at every call: types are looked up once, and arrays can be too.

numba examines every array that enters compiled code, which for those of a stepper takes as long as three substeps. For
`Direct` they lie in memory as the machine code expects them, and what it has written comes back as floats.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit, typeof, types
from numba.extending import intrinsic
from numpy.typing import NDArray

WORD = 8  # bytes of a pointer and of every number


def compiled(stepper: Any, arguments: tuple[Any, ...]) -> Callable[..., None]:
    """Return the machine code for arguments of these types: a call looks up no types, which takes 0.2 us."""
    signature = tuple(typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    stepper.compile(signature)
    code: Callable[..., None] = stepper.get_overload(signature)
    return code


class Direct:
    """A compiled function without result, whose arguments stay but for one whole number and one float in an array.

    ``direct.run(direct.address, number, value)`` calls it and returns floats of an array that it has written: two loads
    and no layer of Python in between.

    Parameters
    ----------
    function : Dispatcher
        Of numba.
    arguments : tuple of arrays, float and int
        Kept, since machine code reads and writes them.
    number : int
        Place of the argument that is given with each call.
    value : array of float64
        Its first element is what is given with each call.
    written : array of float64
        Where the function writes.
    read : sequence of int
        Places in it that are returned.
    """

    def __init__(
        self,
        function: Any,
        arguments: tuple[Any, ...],
        number: int,
        value: NDArray[np.float64],
        written: NDArray[np.float64],
        read: Sequence[int],
    ) -> None:
        signature = tuple(typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
        function.compile(signature)
        found = function.overloads[signature]
        code = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
        words = [code, value.ctypes.data, written.ctypes.data]
        words += [word for argument in arguments for word in _words(argument)]
        self._memory = np.array(words, dtype=np.int64)
        self._kept = found, arguments, value, written
        self.address = self._memory.ctypes.data
        self.run = _caller(signature, number, tuple(read))


def _words(argument: Any) -> list[int]:
    """Return an argument as it lies in memory; an array without an owner, which machine code then need not count."""
    if isinstance(argument, np.ndarray):
        return [0, 0, argument.size, argument.itemsize, argument.ctypes.data, *argument.shape, *argument.strides]
    return [int(np.float64(argument).view(np.int64))] if isinstance(argument, float) else [argument]


@lru_cache(maxsize=64)
def _caller(signature: tuple[types.Type, ...], number: int, read: tuple[int, ...]) -> Any:
    """Return machine code that takes the address of words as above, the number and the value, and returns floats."""
    result: Any = types.UniTuple(types.float64, len(read))  # type: ignore[no-untyped-call]

    @intrinsic
    def call(typing: Any, address: Any, given: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, _: Any, told: Any) -> Any:
            place, given, value = told

            def after(place: Any, size: int) -> Any:
                return builder.add(place, place.type(size))

            def pointer(place: Any, kind: Any) -> Any:
                return builder.inttoptr(place, kind.as_pointer())

            code, to_value, written = (builder.load(pointer(after(place, n * WORD), place.type)) for n in range(3))
            place, arguments = after(place, 3 * WORD), []
            for kind in map(context.get_value_type, signature):
                arguments.append(builder.load(pointer(place, kind)))
                place = after(place, context.get_abi_sizeof(kind))
            arguments[number] = given
            builder.store(value, pointer(to_value, value.type))
            function = pointer(code, context.call_conv.get_function_type(types.none, signature))
            status, _ = context.call_conv.call_function(builder, function, types.none, signature, arguments)
            with builder.if_then(status.is_error, likely=False):
                context.call_conv.return_status_propagate(builder, status)
            floats = [builder.load(pointer(after(written, n * WORD), value.type)) for n in read]
            return context.make_tuple(builder, result, floats)

        return result(types.intp, types.intp, types.float64), generate

    @njit([result(types.intp, types.intp, types.float64)])
    def run(address, given, value):  # type: ignore[no-untyped-def]
        return call(address, given, value)  # type: ignore[call-arg]

    return run.get_overload(run.signatures[0])
