"""What of a kernel follows from its substep and its parameters alone, so that it is computed once for many substeps.

A kernel says its physics in one piece. Its statements that read nothing of the motion are moved here into a function
of their own, as a compiler moves what does not change out of a loop; operations, and so their bits, stay the same.
"""

import ast
import inspect
import textwrap
from dataclasses import dataclass
from functools import lru_cache
from types import FunctionType
from typing import Any

from fdbench.effects import Effect, kernel

COSTLY = (ast.Call, ast.Div, ast.Pow)  # what is worth to be kept rather than computed again
REAL = (
    "sqrt",
    "exp",
    "expm1",
    "log",
    "log1p",
    "sin",
    "cos",
    "tan",
    "tanh",
    "sinh",
    "cosh",
    "atan2",
    "hypot",
    "sin_cos",
)
AS_GIVEN = ("abs", "max", "min")  # of reals a real


@dataclass(frozen=True, kw_only=True, eq=False)
class Parted:
    """A kernel in two functions.

    Attributes
    ----------
    names : tuple of str
        What is handed on from one to the other.
    prepare : compiled function
        (h, *parameters) -> what is handed on.
    rest : compiled function
        The kernel, with what is handed on in front of its states.
    """

    names: tuple[str, ...]
    prepare: Any
    rest: Any


@lru_cache(maxsize=256)
def parted(effect: type[Effect]) -> Parted | None:
    """Return the kernel of an effect in two parts; None where nothing costly follows from parameters alone."""
    function: FunctionType = effect.kernel.py_func
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    if not isinstance(tree, ast.FunctionDef) or function.__closure__:
        return None
    statements = [part for statement in tree.body for part in _single(statement)]
    assigned = frozenset[str]().union(*map(_assigned, statements))
    given = ["h", *(item.symbol for item in effect.parameters())]
    constant = _constant(statements, assigned, set(effect.arguments()) - (set(given) - assigned))
    moved = [item for item in statements if _assigned(item) & constant]
    left = [item for item in statements if item not in moved]
    read = frozenset[str]().union(*map(_read, left))
    names = tuple(dict.fromkeys(name for item in moved for name in sorted(_assigned(item)) if name in read))
    costly = any(isinstance(node, COSTLY) for item in moved for node in ast.walk(item))
    reals = _reals(moved, given, function)
    if not names or not costly or not all(name in reals and _is_read_late(name, statements) for name in names):
        return None
    own = list(effect.arguments())
    place = len(own) - len(effect.states)
    return Parted(
        names=names,
        prepare=_compiled(function, "prepare", given, [*map(ast.unparse, moved), f"return {', '.join(names)},"]),
        rest=_compiled(function, "rest", [*own[:place], *names, *own[place:]], [*map(ast.unparse, left)]),
    )


def _single(statement: ast.stmt) -> list[ast.stmt]:
    """Return an assignment of several values at once as several ones, where none reads what another assigns."""
    if not isinstance(statement, ast.Assign) or not isinstance(statement.value, ast.Tuple):
        return [statement]
    targets = statement.targets[0]
    if not isinstance(targets, ast.Tuple) or _assigned(statement) & _read(statement.value):
        return [statement]
    pairs = zip(targets.elts, statement.value.elts, strict=True)
    return [ast.copy_location(ast.Assign([target], value), statement) for target, value in pairs]


def _constant(statements: list[ast.stmt], assigned: frozenset[str], moving: set[str]) -> set[str]:
    """Return those of the assigned names that follow, wherever they are assigned, from what does not move."""
    found = set(assigned - moving)

    def moves(statement: ast.stmt) -> bool:
        simple = isinstance(statement, ast.Assign | ast.AugAssign) and _assigned(statement) <= found
        return not simple or bool(_read(statement) & (moving | assigned - found))

    while changing := {name for item in statements if moves(item) for name in _assigned(item) & found}:
        found -= changing
    return found


def _assigned(node: ast.AST) -> set[str]:
    return {item.id for item in ast.walk(node) if isinstance(item, ast.Name) and isinstance(item.ctx, ast.Store)}


def _read(node: ast.AST) -> set[str]:
    added = {node.target.id} if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name) else set()
    return added | {item.id for item in ast.walk(node) if isinstance(item, ast.Name) and isinstance(item.ctx, ast.Load)}


def _is_read_late(name: str, statements: list[ast.stmt]) -> bool:
    """Return whether a name is read where it has its last value alone, or where it gets another one."""
    last = max(place for place, item in enumerate(statements) if name in _assigned(item))
    return not any(name in _read(item) and name not in _assigned(item) for item in statements[:last])


def _reals(statements: list[ast.stmt], given: list[str], function: FunctionType) -> set[str]:
    """Return the names that are real for certain wherever they are assigned, neither whole numbers nor truth values."""
    found = {*given, *(name for name, value in function.__globals__.items() if isinstance(value, float))}
    never: set[str] = set()

    def is_real(node: ast.expr) -> bool:
        match node:
            case ast.Constant(value=value):
                return isinstance(value, float)
            case ast.Name(id=name):
                return name in found - never
            case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
                return is_real(operand)
            case ast.BinOp(op=op, left=left, right=right):
                return isinstance(op, ast.Div) or is_real(left) or is_real(right)
            case ast.IfExp(body=body, orelse=other):
                return is_real(body) and is_real(other)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=arguments):
                return name in REAL or (name in AS_GIVEN and any(map(is_real, arguments)))
        return False

    for statement in statements:
        value = statement.value if isinstance(statement, ast.Assign | ast.AugAssign) else None
        (found if value is not None and is_real(value) else never).update(_assigned(statement))
    return found - never


def _compiled(function: FunctionType, name: str, arguments: list[str], lines: list[str]) -> Any:
    """Return a compiled function of these lines, which finds what the kernel finds."""
    text = f"def {name}({', '.join(arguments)}):\n{textwrap.indent(chr(10).join(lines), '    ')}\n"
    space = dict(function.__globals__)
    exec(compile(text, inspect.getfile(function), "exec"), space)
    return kernel(space[name])
