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
NOT_REAL = (ast.Compare, ast.BoolOp)
WHOLE = ("int", "int64", "round", "len", "bool")


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
    if not names or not costly or not all(_can_be_handed_on(name, statements) for name in names):
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


def _can_be_handed_on(name: str, statements: list[ast.stmt]) -> bool:
    """Return whether a name is that of a real number, and is read where it has its last value alone."""
    places = [place for place, item in enumerate(statements) if name in _assigned(item)]
    early = (item for item in statements[: places[-1]] if name in _read(item) and name not in _assigned(item))
    return not any(early) and all(_is_real(statements[place]) for place in places)


def _is_real(statement: ast.stmt) -> bool:
    """Return whether a statement assigns neither a truth value nor a whole number."""
    value = statement.value if isinstance(statement, ast.Assign | ast.AugAssign) else None
    called = getattr(value.func, "attr", getattr(value.func, "id", "")) if isinstance(value, ast.Call) else ""
    negated = isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
    return not negated and not isinstance(value, NOT_REAL) and called not in WHOLE


def _compiled(function: FunctionType, name: str, arguments: list[str], lines: list[str]) -> Any:
    """Return a compiled function of these lines, which finds what the kernel finds."""
    text = f"def {name}({', '.join(arguments)}):\n{textwrap.indent(chr(10).join(lines), '    ')}\n"
    space = dict(function.__globals__)
    exec(compile(text, inspect.getfile(function), "exec"), space)
    return kernel(space[name])
