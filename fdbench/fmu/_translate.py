"""Kernels in C: the few words of Python that they are written in, one by one.

A kernel has numbers, conditions, bounded loops and calls of other kernels; it returns one number or a tuple. Sums and
products keep their order, so that C without contracted operations gives the same numbers.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fdbench.errors import SpecError

REAL, WHOLE = "double", "long long"
_BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_BITS = {ast.BitAnd: "&", ast.LShift: "<<"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_CALLED = {
    **{
        name: f"{name}(%s)" for name in ("sqrt", "floor", "ceil", "copysign", "exp", "log", "sin", "cos", "tanh", "tan")
    },
    **{"abs": "fabs(%s)", "min": "fd_min(%s)", "max": "fd_max(%s)", "hypot": "hypot(%s)", "sign": "fd_sign(%s)"},
    **{"atan2": "atan2(%s)", "arctan2": "atan2(%s)", "fmod": "fmod(%s)", "isnan": "isnan(%s)"},
    **{"float": "(double)(%s)", "int": "(long long)(%s)", "int64": "(long long)(%s)"},
}
LEFT_OUT = ("calls", "first_calls", "ahead", "uniform")  # arguments of ports
_TO_WHOLE = ("int", "int64")


class _NotTranslated(Exception):
    """Something that no kernel of this package says."""


class Translator:
    """Collects the functions that kernels call, each once, in an order in which C knows them.

    Parameters
    ----------
    arrays : mapping of str to str
        Array -> what an element is in C, with the places in ``{0}``, ``{1}`` ....
    """

    def __init__(self, arrays: Mapping[str, str] | None = None) -> None:
        self.functions: list[str] = []
        self._names: dict[Any, tuple[str, int]] = {}
        self._arrays = arrays or {}
        self.ports: Mapping[str, str] = {}  # of the integrator: name -> that of the function in C

    def add(self, function: Any, name: str, constants: Mapping[str, object] | None = None, macro: str = "") -> int:
        """Translate a function under a name and return how many numbers it returns; 0: one, as its own value.

        Parameters
        ----------
        function : compiled or plain function
        name : str
            Its name in C.
        constants : mapping
            Names that it finds where it is generated.
        macro : str
            Arguments of C in place of its own.

        Raises
        ------
        SpecError
            If it says something that is not translated.
        """
        plain = getattr(function, "py_func", function)
        if plain in self._names:
            return self._names[plain][1]
        try:
            body = _Function(self, plain, name, dict(constants or {}), macro)
        except (_NotTranslated, SyntaxError, OSError, TypeError) as error:
            raise SpecError(
                f"{plain.__module__}.{plain.__qualname__}: not written in C for an FMU: {error}."
            ) from error
        self._names[plain] = name, body.width
        self.functions.append(body.text)
        return body.width

    def known(self, function: Any) -> tuple[str, int]:
        """Return name and width of a function that another one calls."""
        plain = getattr(function, "py_func", function)
        if not inspect.isfunction(plain):
            raise _NotTranslated(f"a call of {plain!r}")
        if plain not in self._names:
            self.add(plain, f"{plain.__name__}_{len(self._names)}")
        return self._names[plain]

    def element(self, array: str, places: Sequence[str]) -> str:
        """Return an element of an array."""
        if array not in self._arrays:
            raise _NotTranslated(f"an element of {array}")
        return self._arrays[array].format(*places)


class _Function:
    """One function: its text in C and its width."""

    def __init__(
        self, translator: Translator, function: Callable[..., Any], name: str, constants: dict[str, object], macro: str
    ) -> None:
        self._of, self._constants = translator, constants
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise _NotTranslated("no function")
        self._globals = {**function.__globals__, **inspect.getclosurevars(function).nonlocals}
        arguments = [argument.arg for argument in tree.args.args]
        self._types = dict.fromkeys(arguments, REAL)
        self._extra = 0
        returned = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return) and node.value is not None]
        self.width = max((self._width(value) for value in returned), default=0)
        lines = self._block(tree.body)
        own = {variable: kind for variable, kind in self._types.items() if variable not in arguments}
        declared = [f"    {kind} {variable} = 0;" for variable, kind in own.items()]
        given = macro or ", ".join(
            [f"double {argument}" for argument in arguments] + (["double *result"] if self.width else [])
        )
        kind = "void" if self.width or not returned else REAL
        self.text = "\n".join([f"static {kind} {name}({given})", "{", *declared, *lines, "}", ""])

    def _width(self, value: ast.expr) -> int:
        if isinstance(value, ast.IfExp):
            return max(self._width(value.body), self._width(value.orelse))
        return len(value.elts) if isinstance(value, ast.Tuple) else 0

    # ---- statements ----

    def _block(self, body: Sequence[ast.stmt]) -> list[str]:
        return [f"    {line}" for statement in body for line in self._statement(statement)]

    def _statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return []
            case ast.Assign(targets=[target], value=value):
                return self._assign(target, value)
            case ast.AugAssign(target=target, op=op, value=value):
                return [f"{self._place(target)} = {self._binary(op, self._expr(target), self._expr(value))};"]
            case ast.If(test=test, body=body, orelse=orelse):
                lines = [f"if ({self._expr(test)}) {{", *self._block(body), "}"]
                return [*lines, "else {", *self._block(orelse), "}"] if orelse else lines
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args)):
                self._types[name] = WHOLE
                ends = [self._expr(argument) for argument in args]
                start, stop = ("0", ends[0]) if len(ends) == 1 else (ends[0], ends[1])
                return [f"for ({name} = {start}; {name} < {stop}; {name}++) {{", *self._block(node.body), "}"]
            case ast.Expr(value=ast.Call(func=ast.Name(id=name), args=args)) if name in self._of.ports:
                given = [self._expr(item) for item in args if not (isinstance(item, ast.Name) and item.id in LEFT_OUT)]
                return [f"{self._of.ports[name]}({', '.join(given)});"]
            case ast.Return(value=value) if value is not None:
                return self._return(value)
        raise _NotTranslated(ast.unparse(node).splitlines()[0])

    def _assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        if not isinstance(target, ast.Tuple):
            text = self._expr(value)
            return [f"{self._place(target, self._kind(value))} = {text};"]
        self._extra += 1
        count, own = len(target.elts), f"tuple_{self._extra}"
        if isinstance(value, ast.Tuple):
            lines = [f"{own}[{place}] = {self._expr(item)};" for place, item in enumerate(value.elts)]
        elif isinstance(value, ast.Call):
            name, width = self._of.known(self._resolved(value.func))
            if width != count:
                raise _NotTranslated(ast.unparse(value))
            lines = [f"{name}({', '.join([*map(self._expr, value.args), own])});"]
        else:
            raise _NotTranslated(ast.unparse(value))
        places = [f"{self._place(item)} = {own}[{place}];" for place, item in enumerate(target.elts)]
        return ["{", f"    double {own}[{count}];", *(f"    {line}" for line in (*lines, *places)), "}"]

    def _return(self, value: ast.expr) -> list[str]:
        if isinstance(value, ast.IfExp) and self.width:
            test = self._expr(value.test)
            first, second = self._return(value.body), self._return(value.orelse)
            return [f"if ({test}) {{", *(f"    {line}" for line in first), "}", *second]
        if isinstance(value, ast.Tuple):
            return [*(f"result[{place}] = {self._expr(item)};" for place, item in enumerate(value.elts)), "return;"]
        return [f"return {self._expr(value)};"]

    def _place(self, target: ast.expr, kind: str = REAL) -> str:
        if isinstance(target, ast.Name):
            if self._types.setdefault(target.id, kind) != kind:
                self._types[target.id] = REAL
            return target.id
        return self._expr(target)

    # ---- expressions ----

    def _kind(self, node: ast.expr) -> str:
        """Return whether a value is a whole number."""
        match node:
            case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)) if name in _TO_WHOLE:
                return WHOLE
            case ast.BinOp(op=ast.BitAnd() | ast.LShift()):
                return WHOLE
            case ast.Name(id=name) if name in self._types:
                return self._types[name]
        return REAL

    def _expr(self, node: ast.expr) -> str:
        match node:
            case ast.Constant(value=value):
                return self._constant(value)
            case ast.Name(id=name):
                return name if name in self._types else self._constant(self._resolved(node))
            case ast.Attribute():
                return self._constant(self._resolved(node))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return f"(-{self._expr(operand)})"
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return f"(!{self._expr(operand)})"
            case ast.BinOp(left=left, op=op, right=right):
                return self._binary(op, self._expr(left), self._expr(right))
            case ast.BoolOp(op=op, values=values):
                return f"({(' && ' if isinstance(op, ast.And) else ' || ').join(map(self._expr, values))})"
            case ast.Compare(left=left, ops=ops, comparators=others):
                return self._compared(left, ops, others)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return f"({self._expr(test)} ? {self._expr(body)} : {self._expr(orelse)})"
            case ast.Subscript(value=ast.Name(id=array), slice=ast.Tuple(elts=places)):
                return self._of.element(array, [self._expr(place) for place in places])
            case ast.Subscript(value=ast.Name(id=array), slice=place):
                return self._of.element(array, [self._expr(place)])
            case ast.Call(func=ast.Attribute(value=value, attr="view")):
                return f"fd_bits({self._expr(value)})"
            case ast.Call(func=called, args=args, keywords=[]):
                return self._call(called, [self._expr(argument) for argument in args])
        raise _NotTranslated(ast.unparse(node))

    def _binary(self, op: ast.operator, left: str, right: str) -> str:
        if type(op) in _BINARY:
            return f"({left} {_BINARY[type(op)]} {right})"
        if type(op) in _BITS:
            return f"((long long){left} {_BITS[type(op)]} (long long){right})"
        if isinstance(op, ast.Div):
            return f"((double){left} / (double){right})"
        if isinstance(op, ast.Pow):
            return f"pow({left}, {right})"
        if isinstance(op, ast.Mod):
            return f"fd_mod({left}, {right})"
        raise _NotTranslated(type(op).__name__)

    def _compared(self, left: ast.expr, ops: Sequence[ast.cmpop], others: Sequence[ast.expr]) -> str:
        sides, parts = [self._expr(left), *map(self._expr, others)], []
        for place, op in enumerate(ops):
            if type(op) not in _COMPARED:
                raise _NotTranslated(type(op).__name__)
            parts.append(f"{sides[place]} {_COMPARED[type(op)]} {sides[place + 1]}")
        return f"({' && '.join(parts)})"

    def _call(self, called: ast.expr, arguments: list[str]) -> str:
        function = self._resolved(called)
        if hasattr(function, "py_func") or inspect.isfunction(function):
            name, width = self._of.known(function)
            if width:
                raise _NotTranslated(ast.unparse(called))
            return f"{name}({', '.join(arguments)})"
        word = getattr(function, "__name__", "")
        word = {"absolute": "abs", "fabs": "abs", "minimum": "min", "maximum": "max"}.get(word, word)
        if word not in _CALLED:
            raise _NotTranslated(f"a call of {ast.unparse(called)}")
        if word in ("min", "max"):
            text = arguments[0]
            for other in arguments[1:]:
                text = _CALLED[word] % f"{text}, {other}"
            return text
        return _CALLED[word] % ", ".join(arguments)

    def _resolved(self, node: ast.expr) -> Any:
        """Return what a name stands for outside the function."""
        if isinstance(node, ast.Attribute):
            return getattr(self._resolved(node.value), node.attr)
        if isinstance(node, ast.Name):
            builtin = {"abs": abs, "min": min, "max": max, "float": float, "int": int}
            for names in (self._constants, self._globals, builtin):
                if node.id in names:
                    return names[node.id]
        raise _NotTranslated(ast.unparse(node))

    @staticmethod
    def _constant(value: Any) -> str:
        if isinstance(value, bool):
            return str(int(value))
        if isinstance(value, int):
            return f"{value}LL"
        if isinstance(value, float):
            return {"nan": "NAN", "inf": "INFINITY", "-inf": "(-INFINITY)"}.get(repr(value), repr(float(value)))
        raise _NotTranslated(f"{value!r}")
