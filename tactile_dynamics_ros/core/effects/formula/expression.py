"""Expressions of scalars and vectors as text, read into sympy with their units checked."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import Any

import sympy

from tactile_dynamics_ros.core.effects.parameter import DIMENSIONLESS, Dimension, format_dimension
from tactile_dynamics_ros.core.errors import BadInputError

_PLAIN: dict[str, Any] = {
    "sin": sympy.sin, "cos": sympy.cos, "tan": sympy.tan, "asin": sympy.asin, "acos": sympy.acos,
    "atan": sympy.atan, "sinh": sympy.sinh, "cosh": sympy.cosh, "tanh": sympy.tanh,
    "exp": sympy.exp, "log": sympy.log,
}  # fmt: skip
"""Functions of one plain number, by the names that formulas use. A name that is missing here is
refused in formulas; each that is taken away breaks files that use it."""
FUNCTIONS = (*_PLAIN, "sqrt", "abs", "sign", "min", "max", "atan2", "norm", "dot", "cross")
"""Names of all functions, in the order in which they are listed; they are API. One that is taken
away breaks files that use it."""
_ARGUMENTS = {"min": 2, "max": 2, "atan2": 2, "dot": 2, "cross": 2}
"""Numbers of arguments; all other functions have one. A call with another number is refused."""
LONGEST = 2000
"""Characters of a formula: four lines of a page hold 400, and what is longer reads better as
definitions."""
_DEEPEST = 100
"""Levels of brackets, signs and terms in a formula: a sum of a hundred terms. Python's own reader
ends at about nine hundred without saying where."""
LARGEST_NUMBER = 1e100
"""Largest plain number in a formula, and one over the smallest: products of three such ones still
fit floating point; 9^9^9^9 would be written out, digit by digit."""
_MOST_NODES = 2000
"""Operations of a formula with its definitions put in; `max` needs each of its arguments twice. The
catalogue's longest law has about a hundred."""
_MOST_TERMS = 3000
"""Terms of a formula that is multiplied out, as fits of linear parameters do: (a + b + c)^20 has
231."""
_LARGEST_POWER = 100
"""Largest power of a quantity: laws of nature have 4. Fits hold a place for every power below."""
_SHOWN = 80
"""Characters of a formula that a message shows: a line of a terminal."""
_FINEST_POWER = 12
"""Largest denominator of powers of quantities with a unit: 0.333333 is taken for 1/3, so that units
come out exactly. More would take digits that were typed as they are for fractions. With fewer, 1/12
would be rounded to another fraction and a right unit refused."""


@dataclass(frozen=True)
class Term:
    """A value with its dimension; the number zero (dimension None) fits every unit."""

    value: Any
    dimension: Dimension | None = DIMENSIONLESS

    @property
    def is_vector(self) -> bool:
        """Whether the value is a column of three."""
        return isinstance(self.value, sympy.MatrixBase)


class ExpressionReader:
    """Reads expressions over names that a lookup resolves; evaluates nothing as code."""

    def __init__(self, lookup: Callable[[str], Term], where: str) -> None:
        """Remember the names and the place that messages mention.

        Args:
            lookup: term of a name; raises BadInputError without the place for unknown names.
            where: file and field.
        """
        self._lookup, self._where = lookup, where

    def read(self, text: str) -> Term:
        """Term of an expression such as ``-c*abs(v_x)*v_x`` or ``cross(omega, h)``.

        Raises:
            BadInputError: it is malformed, a name is unknown, or units do not fit.
        """
        if len(text) > LONGEST:
            raise self._error(f"{len(text)} characters, at most {LONGEST}: use definitions")
        source = text.replace("^", "**").strip()
        try:
            tree = ast.parse(source, mode="eval")
        except (SyntaxError, ValueError) as error:
            raise self._error(f"'{_shown(text)}' is not an expression: {error.args[0]}") from error
        except (MemoryError, RecursionError) as error:
            raise self._too_deep() from error
        if _depth(tree.body) > _DEEPEST:
            raise self._too_deep()
        return self._visit(tree.body)

    def read_vector(self, source: object) -> Term:
        """Vector from one vector expression or from three scalar expressions.

        Raises:
            BadInputError: it is neither, or see `read`.
        """
        if isinstance(source, list) and len(source) == 3:
            return self._stack([self.read(str(part)) for part in source], str(source))
        if isinstance(source, list):
            raise self._error(f"has {len(source)} components, expected three or one vector")
        term = self.read(str(source))
        if not term.is_vector:
            if term.dimension is None:
                return Term(sympy.zeros(3, 1), None)
            raise self._error(f"'{source}' is a scalar, expected a vector or three components")
        return term

    def _error(self, message: str) -> BadInputError:
        return BadInputError(f"{self._where}: {message}")

    def _too_deep(self) -> BadInputError:
        return self._error(f"more than {_DEEPEST} levels of brackets, signs or terms")

    def _visit(self, node: ast.expr) -> Term:
        """Return the term of a node, if it can be computed with."""
        text = _shown(ast.unparse(node))
        try:
            term = self._read_node(node, text)
            values = list(term.value) if term.is_vector else [term.value]
            large = next((words for value in values if (words := _excess(value))), "")
        except (ArithmeticError, RecursionError, TypeError, ValueError) as error:
            raise self._error(f"'{text}' has no value ({error})") from error
        if large:
            raise self._error(f"'{text}' {large}")
        return term

    def _read_node(self, node: ast.expr, text: str) -> Term:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | None):
                raise self._error(f"{text} is not a number")
            case ast.Constant(value=int() | float() as number):
                dimension = None if number == 0 else DIMENSIONLESS
                return Term(sympy.sympify(number), dimension)
            case ast.Name(id=name):
                return self._named(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                term = self._visit(operand)
                return Term(-term.value, term.dimension)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self._visit(operand)
            case ast.BinOp(left=left, op=operator, right=right):
                return self._binary(operator, self._visit(left), self._visit(right), text)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._call(name, [self._visit(a) for a in arguments], text)
            case ast.List(elts=parts) if len(parts) == 3:
                return self._stack([self._visit(p) for p in parts], text)
        raise self._error(f"'{text}' is not allowed in a formula: use + - * / ^ and functions")

    def _named(self, name: str) -> Term:
        if name == "pi":
            return Term(sympy.pi)
        try:
            return self._lookup(name)
        except BadInputError as error:
            raise self._error(str(error)) from error

    def _binary(self, operator: ast.operator, left: Term, right: Term, text: str) -> Term:
        match operator:
            case ast.Add() | ast.Sub():
                return self._sum(operator, left, right, text)
            case ast.Mult():
                if left.is_vector and right.is_vector:
                    raise self._error(f"'{text}' multiplies two vectors: use dot or cross")
                return Term(left.value * right.value, _product(left.dimension, right.dimension, 1))
            case ast.Div():
                if right.is_vector or right.dimension is None:
                    raise self._error(f"'{text}' divides by a vector or by zero")
                return Term(left.value / right.value, _product(left.dimension, right.dimension, -1))
            case ast.Pow():
                return self._power(left, right, text)
        raise self._error(f"'{text}' is not allowed in a formula: use + - * / ^ and functions")

    def _sum(self, operator: ast.operator, left: Term, right: Term, text: str) -> Term:
        dimension = self._common(left, right, f"'{text}' adds")
        if left.is_vector != right.is_vector:
            raise self._error(f"'{text}' adds a scalar and a vector")
        sign = 1 if isinstance(operator, ast.Add) else -1
        return Term(left.value + sign * right.value, dimension)

    def _common(self, left: Term, right: Term, doing: str) -> Dimension | None:
        if left.dimension is None or right.dimension is None:
            return left.dimension or right.dimension
        if left.dimension != right.dimension:
            units = f"{format_dimension(left.dimension)} and {format_dimension(right.dimension)}"
            raise self._error(f"{doing} {units}: give the parameters or constants fitting units")
        return left.dimension

    def _power(self, base: Term, exponent: Term, text: str) -> Term:
        """Return a power; one that is too large to write out is refused before it is."""
        if base.is_vector or exponent.is_vector:
            raise self._error(f"'{text}': powers are of scalars; |v|^2 is dot(v, v)")
        self._plain(exponent, f"exponent of '{text}'")
        if base.value.is_number and exponent.value.is_number:
            size = abs(float(exponent.value) * math.log(abs(float(base.value)) or 1.0))
            if size > math.log(LARGEST_NUMBER):
                raise self._error(f"'{text}' {_TOO_LARGE}")
        value = base.value**exponent.value
        if base.dimension in (None, DIMENSIONLESS):
            return Term(value, base.dimension)
        if not exponent.value.is_number:
            unit = format_dimension(base.dimension or DIMENSIONLESS)
            raise self._error(f"'{text}' raises {unit} to a power that is not a number")
        power = Fraction(float(exponent.value)).limit_denominator(_FINEST_POWER)
        return Term(value, _scale(base.dimension, power))

    def _plain(self, term: Term, what: str) -> None:
        if term.dimension not in (None, DIMENSIONLESS):
            unit = format_dimension(term.dimension or DIMENSIONLESS)
            raise self._error(f"{what} has the unit {unit}, expected a plain number: divide by one")

    def _call(self, name: str, arguments: Sequence[Term], text: str) -> Term:
        if name not in FUNCTIONS:
            raise self._error(f"function '{name}' is unknown: expected {', '.join(FUNCTIONS)}")
        expected = _ARGUMENTS.get(name, 1)
        if len(arguments) != expected:
            raise self._error(f"'{text}' has {len(arguments)} arguments, expected {expected}")
        takes_vectors = name in ("norm", "dot", "cross")
        if any(a.is_vector != takes_vectors for a in arguments):
            kind = "vectors" if takes_vectors else "scalars"
            raise self._error(f"'{text}': {name} takes {kind}")
        if name in _PLAIN:
            self._plain(arguments[0], f"argument of '{text}'")
            return Term(_PLAIN[name](arguments[0].value))
        return self._special(name, arguments, text)

    def _special(self, name: str, arguments: Sequence[Term], text: str) -> Term:
        first, last = arguments[0], arguments[-1]
        product = _product(first.dimension, last.dimension, 1)
        if name in ("min", "max", "atan2"):
            dimension = self._common(first, last, f"'{text}' compares")
            if name == "atan2":
                return Term(sympy.atan2(first.value, last.value))
            sign = 1 if name == "max" else -1
            gap = sympy.Abs(first.value - last.value)
            return Term((first.value + last.value + sign * gap) / 2, dimension)
        match name:
            case "sqrt":
                return Term(sympy.sqrt(first.value), _scale(first.dimension, Fraction(1, 2)))
            case "abs":
                return Term(sympy.Abs(first.value), first.dimension)
            case "sign":
                return Term(sympy.sign(first.value))
            case "norm":
                return Term(sympy.sqrt(first.value.dot(first.value)), first.dimension)
            case "dot":
                return Term(first.value.dot(last.value), product)
        return Term(first.value.cross(last.value), product)

    def _stack(self, parts: Sequence[Term], text: str) -> Term:
        if any(part.is_vector for part in parts):
            raise self._error(f"{text}: components must be scalars")
        dimension: Dimension | None = None
        for part in parts:
            dimension = self._common(Term(0, dimension), part, f"{text} mixes")
        return Term(sympy.Matrix([part.value for part in parts]), dimension)


_TOO_LARGE = f"is beyond {LARGEST_NUMBER:g}, or one over that"


def _shown(text: str) -> str:
    """Return a formula as it is shown in a message of one line."""
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]} ..."


def _depth(node: ast.AST) -> int:
    """Return how many levels a tree has; no recursion, since it may have thousands."""
    depth, level = 0, [node]
    while level:
        depth += 1
        level = [child for one in level for child in ast.iter_child_nodes(one)]
    return depth


def _excess(value: Any) -> str:
    """Return what a value is beyond; empty if it can be computed with."""
    if value.is_number:
        if complex(value).imag != 0.0:
            return "is no real number"
        size = abs(complex(value))
        written_out = value.is_Rational and 0.0 < size < 1.0 / LARGEST_NUMBER
        return "" if size <= LARGEST_NUMBER and not written_out else _TOO_LARGE
    if value.has(sympy.zoo, sympy.nan, sympy.oo):
        return "divides by zero"
    nodes = list(islice(sympy.preorder_traversal(value), _MOST_NODES + 1))
    if len(nodes) > _MOST_NODES:
        return f"has more than {_MOST_NODES} operations once definitions are put in"
    powers = [node.exp for node in nodes if node.is_Pow and node.exp.is_number]
    if any(abs(complex(power)) > _LARGEST_POWER for power in powers):
        return f"has a power above {_LARGEST_POWER}"
    if _terms(value) > _MOST_TERMS:
        return f"has more than {_MOST_TERMS} terms if multiplied out"
    return ""


def _terms(value: Any) -> int:
    """Return how many terms a value has if products and powers of sums are multiplied out."""
    if value.is_Add:
        return sum(map(_terms, value.args))
    if value.is_Mul:
        return math.prod(map(_terms, value.args))
    if value.is_Pow and value.exp.is_Integer and value.exp > 0:
        power, of_base = int(value.exp), _terms(value.base)
        return 1 if of_base == 1 else math.comb(min(power, _MOST_TERMS) + of_base - 1, of_base - 1)
    return 1


def _product(left: Dimension | None, right: Dimension | None, sign: int) -> Dimension | None:
    if left is None or right is None:
        return None
    return (left[0] + sign * right[0], left[1] + sign * right[1], left[2] + sign * right[2])


def _scale(dimension: Dimension | None, power: Fraction) -> Dimension | None:
    if dimension is None:
        return None
    return (dimension[0] * power, dimension[1] * power, dimension[2] * power)
