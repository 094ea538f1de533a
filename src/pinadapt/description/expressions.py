"""Expressions of xacro files: numbers, texts, lists and functions of mathematics, nothing else.

xacro hands them to Python's ``eval``, by which a description could run any code. Here they go
through simpleeval with a list of what is allowed. Sizes of numbers, texts and lists are bounded,
so that no expression takes long.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import simpleeval

from ..exceptions import RobotError

LONGEST = 100_000  # characters and elements of a value, together
_BITS = 1024  # of a whole number; beyond it no float holds it
_TEXT = 10_000  # characters of an expression
_HINT = (
    "Expressions may use numbers, texts, lists, dictionaries, + - * / // % **, comparisons, and, "
    "or, not, if else, items as in a[0], a['key'] or a.key of YAML, pi, functions of math, and "
    "abs, all, any, bool, dict, divmod, enumerate, float, int, len, list, max, min, range, "
    "reversed, round, sorted, str, sum, tuple, zip; of xacro: arg, dotify, load_yaml, tokenize."
)


def _bounded(value: Any) -> Any:
    """Return a value; refuse what is not data, and what is too large."""
    left: list[Any] = [value]
    size = 0
    while left:
        each = left.pop()
        if isinstance(each, str):
            size += len(each)
        elif isinstance(each, (list, tuple)):
            size += len(each)
            left += each[: LONGEST - size + 1]
        elif isinstance(each, dict):
            size += len(each)
            left += [*each.keys(), *dict.values(each)]
        elif isinstance(each, int):
            if each.bit_length() > _BITS:
                raise RobotError("a whole number has more than 300 digits.", hint=_HINT)
        elif not isinstance(each, (float, type(None))):
            raise RobotError(f"a value is of the kind '{type(each).__name__}'.", hint=_HINT)
        if size > LONGEST:
            raise RobotError(f"a value has more than {LONGEST} characters or elements.")
    return value


def _product(a: Any, b: Any) -> Any:
    """Return a b, where a text or a list times a number does not become too long."""
    for several, times in ((a, b), (b, a)):
        if isinstance(several, (str, list, tuple)) and len(several) * times > LONGEST:
            raise RobotError(f"a value has more than {LONGEST} characters or elements.")
    return a * b


def _power(a: float, b: float) -> float:
    """Return a^b, exact for whole numbers that are not too large."""
    if not isinstance(a, int) or not isinstance(b, int) or b < 0:
        return math.pow(a, b)
    if b * max(a.bit_length(), 1) > 2 * _BITS:
        raise RobotError(f"{a}**{b} is too large.", hint=_HINT)
    return int(a**b)


def _remainder(a: Any, b: Any) -> Any:
    """Return a modulo b of numbers; texts are not formatted."""
    if isinstance(a, str):
        raise RobotError("a text cannot be formatted by %.", hint="Join texts by + and str().")
    return a % b


def _range(*limits: int) -> list[int]:
    """Return whole numbers."""
    if len(range(*limits)) > LONGEST:
        raise RobotError(f"a range has more than {LONGEST} numbers.")
    return list(range(*limits))


def _as_list(function: Callable[..., Iterable[Any]]) -> Callable[..., list[Any]]:
    """Return a function that returns a list where another one returns an iterator."""
    return lambda *given: list(function(*given))


_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: _product,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: _remainder,
    ast.Pow: _power,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda item, several: item in several,
    ast.NotIn: lambda item, several: item not in several,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}
_SLOW = {"factorial", "comb", "perm", "prod"}  # of whole numbers, which they make large
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: f for name, f in vars(math).items() if callable(f) and name[0] != "_"},
    **{f.__name__: f for f in (abs, all, any, bool, dict, divmod, float, int, len, list, max)},
    **{f.__name__: f for f in (min, round, sorted, str, sum, tuple)},
    "range": _range,
    **{f.__name__: _as_list(f) for f in (enumerate, reversed, zip)},
    "pow": _power,
}
_NAMESPACES = "math", "python", "xacro"  # in front of a function or a constant
CONSTANTS = {"pi": math.pi, "e": math.e, "tau": math.tau, "inf": math.inf, "nan": math.nan}


class _Evaluator(simpleeval.SimpleEval):
    """simpleeval without attributes, statements and formatted texts.

    Args:
        lookup: name -> value; raises KeyError.
        functions: that the expression may call, besides those of mathematics.
    """

    def __init__(
        self, lookup: Callable[[str], Any], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        super().__init__(operators=_OPERATORS, functions={}, names={})
        self._lookup = lookup
        self._known = {k: f for k, f in _FUNCTIONS.items() if k not in _SLOW} | {**functions}
        kept = ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Subscript, ast.Slice
        handlers: dict[type[ast.AST], Callable[[Any], Any]] = vars(self)["nodes"]
        self.nodes = {kind: handlers[kind] for kind in kept} | {
            ast.Constant: lambda node: _bounded(node.value),
            ast.Name: self._name,
            ast.BinOp: lambda node: _bounded(self._eval_binop(node)),
            ast.Attribute: self._key_by_dot,
            ast.Call: self._call,
            ast.List: lambda node: _bounded([self._eval(each) for each in node.elts]),
            ast.Tuple: lambda node: _bounded(tuple(self._eval(each) for each in node.elts)),
            ast.Dict: self._dictionary,
        }

    def _name(self, node: ast.Name) -> Any:
        try:
            return _bounded(self._lookup(node.id))
        except KeyError:
            raise RobotError(f"'{node.id}' is not defined.", hint=_HINT) from None

    def _key_by_dot(self, node: ast.Attribute) -> Any:
        """Return a constant of a namespace, or an item of a dictionary, never an attribute."""
        if isinstance(node.value, ast.Name) and node.value.id in _NAMESPACES:
            if node.attr in CONSTANTS:
                return CONSTANTS[node.attr]
        else:
            owner = self._owner(node.value)
            if isinstance(owner, dict) and node.attr in owner:
                return _bounded(owner[node.attr])
        raise RobotError(f"'{ast.unparse(node)}' is not defined.", hint=_HINT)

    def _owner(self, node: ast.expr) -> Any:
        """Return what stands before a dot: a namespace of included files is no value by itself."""
        if not isinstance(node, ast.Name):
            return self._eval(node)
        try:
            return self._lookup(node.id)
        except KeyError:
            return None

    def _call(self, node: ast.Call) -> Any:
        name = ""
        if isinstance(node.func, ast.Name):
            name = node.func.id
        elif isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            name = node.func.attr if node.func.value.id in _NAMESPACES else ""
        if name not in self._known:
            raise RobotError(f"'{ast.unparse(node.func)}' cannot be called.", hint=_HINT)
        values = [self._eval(each) for each in node.args]
        named = {str(each.arg): self._eval(each.value) for each in node.keywords}
        return _bounded(self._known[name](*values, **named))

    def _dictionary(self, node: ast.Dict) -> dict[Any, Any]:
        if None in node.keys:
            raise RobotError("a dictionary with ** in it.", hint=_HINT)
        keys = [self._eval(each) for each in node.keys if each is not None]
        return dict(_bounded(dict(zip(keys, map(self._eval, node.values), strict=True))))


def evaluate(
    text: str,
    lookup: Callable[[str], Any],
    functions: Mapping[str, Callable[..., Any]],
) -> Any:
    """Return the value of an expression: a number, a text, a list, a tuple or a dictionary.

    Args:
        text: of the expression, in Python's syntax.
        lookup: name -> value of a property or constant; raises KeyError.
        functions: name -> function, besides those of mathematics.

    Raises:
        RobotError: what the expression uses is not allowed, not defined or too large.
        SyntaxError, TypeError, ValueError, ZeroDivisionError, OverflowError: as Python has them.
    """
    if len(text) > _TEXT:
        raise RobotError(f"an expression has more than {_TEXT} characters.")
    tree = ast.parse(text.strip(), mode="eval").body
    try:
        return _Evaluator(lookup, functions).eval(text, previously_parsed=tree)
    except simpleeval.InvalidExpression as error:
        raise RobotError(f"{str(error).rstrip('.')}.", hint=_HINT) from error
