r"""Forward-mode differentiation of a compiled function's text: each statement is preceded by that of its tangent.

.. math:: z = f(x, y) \quad \Rightarrow \quad \dot z = \partial_x f \, \dot x + \partial_y f \, \dot y

with the tangent :math:`\dot x` the derivative of x in one direction. Sums, products, quotients and choices are
differentiated here, functions by `fdbench.effects._derivatives`; a choice has the tangent of the branch that is active.
Values are computed as before, and tangents are exact to rounding: there is no step. Source: Griewank, Walther,
Evaluating Derivatives, 2nd ed. (2008), section 3.1.
"""

import ast
import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

from fdbench.errors import PluginError

Moves = tuple[bool, ...]


class Called(NamedTuple):
    """The function that computes a value and its tangent, and the arguments behind which it takes tangents."""

    name: str
    moves: Moves


class ForwardMode(ast.NodeVisitor):
    """Text of functions that return each of their results and, behind it, its tangent.

    Parameters
    ----------
    called : callable
        What takes the place of a call, from the function's name and which arguments move; None: the call stays.
    where : str
        Where the functions stand, for errors.
    block : str
        Name of the array whose tangents lie ``TANGENT`` elements behind its values.
    """

    def __init__(self, called: Callable[[str, Moves], Called | None], where: str, block: str = "") -> None:
        self._called, self._where, self._block = called, where, block
        self._moving: set[str] = set()
        self._lines: list[str] = []
        self._indent, self._n_calls = "", 0

    def text(self, function: ast.stmt, moves: Moves) -> str:
        """Return the text of a function of which some arguments move.

        Raises
        ------
        PluginError
            If it has a statement or an operation without a rule.
        """
        if not isinstance(function, ast.FunctionDef):
            raise self._refusal(function)
        names = [argument.arg for argument in function.args.args]
        self._moving = {name for name, moving in zip(names, moves, strict=True) if moving}
        taken = _interleaved(names, [f"tangent_{name}" if name in self._moving else "" for name in names])
        known = -1
        while len(self._moving) > known:  # a name may move only from a later statement on
            known, self._lines, self._indent, self._n_calls = len(self._moving), [], "    ", 0
            self._statements(function.body)
        still = [
            f"    tangent_{name} = 0.0" for name in names if name in self._moving and f"tangent_{name}" not in taken
        ]
        return "\n".join([f"def {function.name}({', '.join(taken)}):", *still, *self._lines])

    def _emit(self, line: str) -> None:
        self._lines.append(self._indent + line)

    def _under(self, head: str, statements: Sequence[ast.stmt]) -> None:
        self._emit(head)
        before, self._indent = self._indent, f"{self._indent}    "
        self._statements(statements)
        self._indent = before

    def _statements(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            self.visit(statement)

    def generic_visit(self, node: ast.AST) -> None:
        """Refuse what has no rule."""
        raise self._refusal(node)

    def _refusal(self, node: ast.AST) -> PluginError:
        return PluginError(f"{self._where}: `{ast.unparse(node)}` has no rule of differentiation.")

    def visit_Expr(self, node: ast.Expr) -> None:
        """Call a function for what it does to arrays; leave out a docstring."""
        if isinstance(node.value, ast.Call):
            self._emit(self._call(node.value)[0])

    def visit_For(self, node: ast.For) -> None:
        """Keep a loop."""
        self._under(f"for {ast.unparse(node.target)} in {ast.unparse(node.iter)}:", node.body)

    def visit_If(self, node: ast.If) -> None:
        """Keep a branch."""
        self._under(f"if {ast.unparse(node.test)}:", node.body)
        if node.orelse:
            self._under("else:", node.orelse)

    def visit_Return(self, node: ast.Return) -> None:
        """Return tangents behind values."""
        results = [] if node.value is None else _parts(node.value)
        found = [self._value(result) for result in results]
        both = _interleaved([value for value, _ in found], [tangent or "0.0" for _, tangent in found])
        self._emit(f"return {', '.join(both)}".rstrip())

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Assign the sum, product or quotient."""
        now = ast.parse(ast.unparse(node.target), mode="eval").body
        self.visit_Assign(ast.Assign(targets=[node.target], value=ast.BinOp(now, node.op, node.value)))

    def visit_Assign(self, node: ast.Assign) -> None:
        """Assign tangents, which may need what a value was before, and then values."""
        targets = [item for target in node.targets for item in _parts(target)]
        if isinstance(node.value, ast.Call) and isinstance(node.targets[0], ast.Tuple):
            text, called = self._call(node.value)
            if called is not None:
                places = [self._place(target, moves=True) for target in targets]
                self._emit(f"{', '.join(_interleaved(list(map(ast.unparse, targets)), places))} = {text}")
                return
            found = [("", "")] * len(targets)
        else:
            found = [self._value(part) for part in _parts(node.value)]
            text = ", ".join(value for value, _ in found)
        if len(found) != len(targets):
            raise self._refusal(node)
        places = [self._place(target, moves=bool(tangent)) for target, (_, tangent) in zip(targets, found, strict=True)]
        tangents = [tangent or "0.0" for place, (_, tangent) in zip(places, found, strict=True) if place != "_"]
        if tangents:
            self._emit(f"{', '.join(place for place in places if place != '_')} = {', '.join(tangents)}")
        self._emit(f"{', '.join(map(ast.unparse, targets))} = {text}")

    def _place(self, target: ast.expr, *, moves: bool) -> str:
        """Return where the tangent of a target is kept; ``_`` where it has none."""
        if isinstance(target, ast.Name) and moves:
            self._moving.add(target.id)
        return self._tangent(target) or "_"

    def _value(self, expression: ast.expr) -> tuple[str, str]:
        """Return value and tangent of an expression, the tangent empty where it is none."""
        plain = _Hoisted(self._hoisted).visit(copy.deepcopy(expression))
        return ast.unparse(plain), self._tangent(plain)

    def _hoisted(self, node: ast.Call) -> ast.expr:
        """Return the name of what a call returns, which is computed before, or a call whose result does not move."""
        text, called = self._call(node)
        if called is None:
            return node
        self._n_calls += 1
        name = f"call_{self._n_calls}"
        self._emit(f"{name}, tangent_{name} = {text}")
        self._moving.add(name)
        return ast.Name(name)

    def _call(self, node: ast.Call) -> tuple[str, Called | None]:
        arguments = [self._value(argument) for argument in node.args]
        called = self._called(ast.unparse(node.func), tuple(bool(tangent) for _, tangent in arguments))
        values = [value for value, _ in arguments]
        if called is None:
            return f"{ast.unparse(node.func)}({', '.join(values)})", None
        pairs = zip(arguments, called.moves, strict=True)
        tangents = [(tangent or "0.0") if moves else "" for (_, tangent), moves in pairs]
        return f"{called.name}({', '.join(_interleaved(values, tangents))})", called

    def _tangent(self, expression: ast.expr) -> str:
        """Return the tangent of an expression without calls that move, empty where it is none."""
        match expression:
            case ast.Name(id=name):
                return f"tangent_{name}" if name in self._moving else ""
            case ast.Subscript(value=ast.Name(id=name), slice=index) if name == self._block:
                return "" if isinstance(index, ast.Slice) else f"{name}[TANGENT + {ast.unparse(index)}]"
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _product("-1.0", self._tangent(operand))
            case ast.BinOp(left=left, op=operator, right=right):
                return self._of_operation(left, operator, right)
            case ast.IfExp(test=test, body=body, orelse=otherwise):
                chosen, other = self._tangent(body), self._tangent(otherwise)
                return f"({chosen or '0.0'} if {ast.unparse(test)} else {other or '0.0'})" if chosen or other else ""
            case ast.Constant() | ast.Compare() | ast.BoolOp() | ast.Call():  # a call that is left does not move
                return ""
        if any(isinstance(node, ast.Name) and node.id in self._moving for node in ast.walk(expression)):
            raise self._refusal(expression)
        return ""

    def _of_operation(self, left: ast.expr, operator: ast.operator, right: ast.expr) -> str:
        first, second = self._tangent(left), self._tangent(right)
        a, b = f"({ast.unparse(left)})", f"({ast.unparse(right)})"
        if not first and not second:
            return ""
        match operator:
            case ast.Add():
                return _sum(first, second)
            case ast.Sub():
                return _sum(first, _product("-1.0", second))
            case ast.Mult():
                return _sum(_product(first, b), _product(a, second))
            case ast.Div():
                over = _sum(first, _product(f"(-({a} / {b}))", second))
                return f"({over} / {b})"
            case ast.Pow() if not second:
                return _product(f"({b} * {a} ** ({b} - 1))", first)
        raise self._refusal(ast.BinOp(left, operator, right))


class _Hoisted(ast.NodeTransformer):
    """An expression in which calls are replaced; comparisons and indices have no tangent and stay."""

    def __init__(self, replaced: Callable[[ast.Call], ast.expr]) -> None:
        self._replaced = replaced

    def visit_Call(self, node: ast.Call) -> ast.expr:
        return self._replaced(node)

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        return node


def _parts(expression: ast.expr) -> list[ast.expr]:
    return list(expression.elts) if isinstance(expression, ast.Tuple) else [expression]


def _interleaved(values: Sequence[str], tangents: Sequence[str]) -> list[str]:
    return [text for pair in zip(values, tangents, strict=True) for text in pair if text]


def _sum(a: str, b: str) -> str:
    return f"({a} + {b})" if a and b else a or b


def _product(a: str, b: str) -> str:
    return f"({a} * {b})" if a and b else ""
