"""Symbolic expression graph: hash-consed nodes, simplified when made, with forward-mode differentiation."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any, SupportsFloat

from model.errors import InputError

_interned: dict[tuple[Any, ...], Expression] = {}
_count = itertools.count()
TRUTHS = ("above", "at_least", "differs", "and", "or", "not", "bit")


class Expression:
    """A number, or a truth value (see `TRUTHS`): what is done, to which others, and when it was first made."""

    __slots__ = ("args", "op", "order")

    def __init__(self, op: str, args: tuple[Any, ...]) -> None:
        self.op, self.args, self.order = op, args, next(_count)

    def __add__(self, other: Number) -> Expression:
        return _add(self, as_expression(other))

    def __radd__(self, other: Number) -> Expression:
        return _add(as_expression(other), self)

    def __sub__(self, other: Number) -> Expression:
        return _subtract(self, as_expression(other))

    def __rsub__(self, other: Number) -> Expression:
        return _subtract(as_expression(other), self)

    def __mul__(self, other: Number) -> Expression:
        return _multiply(self, as_expression(other))

    def __rmul__(self, other: Number) -> Expression:
        return _multiply(as_expression(other), self)

    def __truediv__(self, other: Number) -> Expression:
        return _divide(self, as_expression(other))

    def __rtruediv__(self, other: Number) -> Expression:
        return _divide(as_expression(other), self)

    def __neg__(self) -> Expression:
        return _negate(self)

    def __abs__(self) -> Expression:
        return intern("abs", self)

    def __gt__(self, other: Number) -> Expression:
        return intern("above", self, as_expression(other))

    def __lt__(self, other: Number) -> Expression:
        return intern("above", as_expression(other), self)

    def __ge__(self, other: Number) -> Expression:
        return intern("at_least", self, as_expression(other))

    def __le__(self, other: Number) -> Expression:
        return intern("at_least", as_expression(other), self)

    def __and__(self, other: Expression) -> Expression:
        return intern("and", self, other)

    def __or__(self, other: Expression) -> Expression:
        return intern("or", self, other)

    def __invert__(self) -> Expression:
        return intern("not", self)

    def __pow__(self, exponent: Any) -> Expression:
        if isinstance(exponent, Expression) or float(exponent) != int(exponent) or not 1 <= exponent <= MOST_FACTORS:
            raise _refuse_evaluation(f"** {exponent if not isinstance(exponent, Expression) else 'an expression'}",
                    f"a whole exponent from 1 to {MOST_FACTORS}, or root(x) in place of x ** 0.5")  # fmt: skip
        product = self
        for _ in range(int(exponent) - 1):
            product = product * self
        return product

    def __rpow__(self, base: Any) -> Expression:
        raise _refuse_evaluation(f"{base} ** an expression", "exponential(x)")

    def __eq__(self, other: object) -> bool:
        if isinstance(other, SupportsFloat) and not isinstance(other, Expression):
            raise _refuse_evaluation("== or != between an expression and a number", "> and < in where(condition, a, b)")
        return self is other

    __hash__ = object.__hash__

    def __bool__(self) -> bool:
        raise _refuse_evaluation("Python's if, and, or, not or min, max on an expression",
                "where(condition, a, b), &, |, ~, minimum(a, b), maximum(a, b)")  # fmt: skip

    def __float__(self) -> float:
        raise _refuse_evaluation("a function for plain numbers, as of math, on an expression",
                "root, exponential, tanh, sine and cosine of model.compiler.expressions")  # fmt: skip

    def __array_ufunc__(self, function: Any, method: str, *given: Any, **more: Any) -> Expression:
        """Numbers of NumPy beside an expression are plain ones; functions of NumPy are refused."""
        if method == "__call__" and function.__name__ in _NUMPY_OPERATORS and len(given) == 2:
            a, b = (x if isinstance(x, Expression) else float(x) for x in given)
            return _NUMPY_OPERATORS[function.__name__](as_expression(a), as_expression(b))
        raise _refuse_evaluation(f"numpy.{function.__name__} on an expression",
                "root, exponential, tanh, sine, cosine, maximum and minimum of model.compiler.expressions")  # fmt: skip


MOST_FACTORS = 8
"""Of a power that is written out as a product."""


def _refuse_evaluation(found: str, instead: str) -> InputError:
    """Error that an expression has no value while a program is written; ``instead`` says what to write."""
    return InputError(f"expression: found {found}, whose value is not known yet; write {instead}")


Number = Expression | float
Arguments = tuple[Expression, ...]
"""What a law is differentiated by."""


def intern(op: str, *args: Any) -> Expression:
    """The one expression of an operation and its arguments."""
    key = (op, *args)
    found = _interned.get(key)
    if found is None:
        found = _interned[key] = Expression(op, args)
    return found


def clear_cache() -> None:
    """Let go of all expressions but the plain numbers that others are made with, once a program is written."""
    _interned.clear()
    _partials.clear()
    _interiors.clear()
    for plain in (ZERO, ONE):
        _interned[plain.op, *plain.args] = plain


def constant(x: float) -> Expression:
    """Expression of a constant; -0 becomes 0."""
    return intern("constant", float(x) + 0.0)


def as_expression(x: Number) -> Expression:
    if isinstance(x, Expression):
        return x
    if isinstance(x, bool) or not isinstance(x, SupportsFloat):
        raise _refuse_evaluation(f"{x!r} beside an expression", "a number or another expression")
    return constant(float(x))


def read(array: str, place: int, *further: Expression) -> Expression:
    """Expression that reads element ``place`` of a kernel's array, ``further`` (an integer) elements on."""
    return intern("read", array, place, *further)


def argument(name: str) -> Expression:
    """Expression of an argument of the kernel, by its name."""
    return intern("argument", name)


def value_of(name: str) -> Expression:
    """Expression that reads a variable of the program, as an earlier statement set it."""
    return intern("read", "local", name)


def _value(e: Expression) -> float | None:
    return e.args[0] if e.op == "constant" else None


def _add(a: Expression, b: Expression) -> Expression:
    """a + b as an expression, simplified: zeros, constants and negatives are folded."""
    if a is ZERO:
        return b
    if b is ZERO:
        return a
    if a.op == b.op == "constant":
        return constant(a.args[0] + b.args[0])
    if b.op == "negative":
        return _subtract(a, b.args[0])
    if a.op == "negative":
        return _subtract(b, a.args[0])
    return intern("add", a, b) if a.order <= b.order else intern("add", b, a)


def _subtract(a: Expression, b: Expression) -> Expression:
    """a - b as an expression, simplified: zeros, constants, and terms that cancel, are folded."""
    if b is ZERO:
        return a
    if a is ZERO:
        return _negate(b)
    if a is b:
        return ZERO
    if b.op == "add" and a in b.args:  # arms: a point less the pivot that it was counted from
        return _negate(b.args[1] if b.args[0] is a else b.args[0])
    if a.op == "add" and b in a.args:
        return a.args[1] if a.args[0] is b else a.args[0]
    if a.op == "subtract" and a.args[0] is b:
        return _negate(a.args[1])
    if b.op == "subtract" and b.args[0] is a:
        return b.args[1]
    if a.op == b.op == "constant":
        return constant(a.args[0] - b.args[0])
    if b.op == "negative":
        return _add(a, b.args[0])
    if a.op == "negative":
        return _negate(_add(a.args[0], b))
    return intern("subtract", a, b)


def _negate(a: Expression) -> Expression:
    """-a as an expression, simplified: constants and double negatives are folded."""
    if a.op == "constant":
        return constant(-a.args[0])
    if a.op == "negative":
        return a.args[0]
    if a.op == "subtract":
        return intern("subtract", a.args[1], a.args[0])
    return intern("negative", a)


def _multiply(a: Expression, b: Expression) -> Expression:
    """a b as an expression, simplified: zeros, ones, constants and negatives are folded."""
    if a is ZERO or b is ZERO:
        return ZERO
    if a.op == b.op == "constant":
        return constant(a.args[0] * b.args[0])
    for one, other in ((a, b), (b, a)):
        if one is ONE:
            return other
        if _value(one) == -1.0:
            return _negate(other)
        if one.op == "negative":
            return _negate(_multiply(one.args[0], other))
    return intern("multiply", a, b) if a.order <= b.order else intern("multiply", b, a)


def _divide(a: Expression, b: Expression) -> Expression:
    """a / b as an expression, simplified: by a constant it becomes a product."""
    if a is ZERO:
        return ZERO
    if b is ONE:
        return a
    if b.op == "constant" and b.args[0] != 0.0:
        return _multiply(a, constant(1.0 / b.args[0]))
    return intern("inverse", b) if a is ONE else _multiply(a, intern("inverse", b))


_NUMPY_OPERATORS: dict[str, Callable[[Expression, Expression], Expression]] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "greater": lambda a, b: a > b,
    "greater_equal": lambda a, b: a >= b,
    "less": lambda a, b: a < b,
    "less_equal": lambda a, b: a <= b,
}
"""What NumPy calls where a number of its own stands before an operator."""

ZERO, ONE = constant(0.0), constant(1.0)


def root(a: Expression) -> Expression:
    return intern("root", a)


def exponential(a: Expression) -> Expression:
    """Exponential of a number up to 700 in size."""
    return intern("exponential", a)


def power(a: Expression, exponent: Expression) -> Expression:
    """A number from 0 on to a power, by the C library; there is no rule to differentiate it."""
    return intern("power", a, exponent)


def tanh(a: Expression) -> Expression:
    """Hyperbolic tangent."""
    return intern("tanh", a)


def cosine(a: Expression) -> Expression:
    return intern("cosine", a)


def sine(a: Expression) -> Expression:
    return intern("sine", a)


def maximum(*numbers: Number) -> Expression:
    """The largest of some numbers."""
    first, *others = (as_expression(x) for x in numbers)
    for x in others:
        first = intern("larger", first, x)
    return first


def minimum(a: Number, b: Number) -> Expression:
    """The smaller of two numbers."""
    return intern("smaller", as_expression(a), as_expression(b))


largest, smaller = maximum, minimum  # their former names, for one release


def where(condition: Expression, a: Number, b: Number) -> Expression:
    """One of two numbers; both are computed."""
    a, b = as_expression(a), as_expression(b)
    return a if a is b else intern("where", condition, a, b)


def compute_where(condition: Expression, a: Number) -> Expression:
    a = as_expression(a)
    return ZERO if a is ZERO else intern("guarded", condition, a)


def total(terms: Iterable[Expression]) -> Expression:
    """Sum of some numbers."""
    return sum(terms, ZERO)


def differentiate_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a law: its derivatives by its first argument, a tuple, are formed once and shared.

    Without it a chain of n coordinates would differentiate the law's inside n times.
    """

    def wrapper(given: tuple[Number, ...], *rest: Any) -> Any:
        named = tuple(x if x.op == "constant" else intern("named", x) for x in map(as_expression, given))
        by = tuple(x for x in named if x.op == "named")
        out = function(named, *rest)
        if isinstance(out, tuple):
            return tuple(x if x.op in TRUTHS else _wrap_subgraph(x, by) for x in out)
        return _wrap_subgraph(out, by)

    wrapper.__doc__ = function.__doc__
    return wrapper


def _wrap_subgraph(value: Expression, by: tuple[Expression, ...]) -> Expression:
    return intern("law", value, *by) if by and value.op not in ("constant", "named") else value


def subexpressions(wholes: Iterable[Expression], excluded: Iterable[Expression] = ()) -> set[Expression]:
    """The expressions ``wholes`` and all that they are made of, without ``excluded`` and what is reached through these
    alone."""
    seen, todo = set(excluded), list(wholes)
    out = set()
    while todo:
        x = todo.pop()
        if x not in seen:
            seen.add(x)
            out.add(x)
            todo += [a for a in x.args if isinstance(a, Expression)]
    return out


def solve_by_newton(unknown: Expression, residual: Expression, start: Number) -> Expression:
    return intern("newton", unknown, residual, differentiator({unknown: ONE})(residual), as_expression(start))


_partials: dict[tuple[Any, ...], Expression] = {}
_interiors: dict[Expression, frozenset[Expression]] = {}


def _interior_nodes(law: Expression) -> frozenset[Expression]:
    if law not in _interiors:
        value, *by = law.args
        _interiors[law] = frozenset(subexpressions([value], by))
    return _interiors[law]


def _cached_partial(value: Expression, x: Expression, by: tuple[Expression, ...]) -> Expression:
    key = (value, x, by)
    if key not in _partials:
        _partials[key] = differentiator({one: ONE if one is x else ZERO for one in by})(value)
    return _partials[key]


def differentiator(along: dict[Expression, Expression]) -> Callable[[Expression], Expression]:
    """Return the forward-mode derivative along a direction; ``along`` maps variables to their rates."""
    known = dict(along)

    def slope(e: Expression) -> Expression:
        found = known.get(e)
        if found is None:
            found = _apply_chain_rule(e, slope)
            if e.op == "law" and not along.keys().isdisjoint(
                _interior_nodes(e)
            ):  # a law of what changes, by itself too
                found = found + differentiator(along | dict.fromkeys(e.args[1:], ZERO))(e.args[0])
            known[e] = found
        return found

    return slope


def substitute(e: Expression, by: dict[Expression, Expression]) -> Expression:
    """Copy of an expression in which the parts that are keys of ``by`` are replaced by their values."""
    known = dict(by)

    def go(x: Any) -> Any:
        if not isinstance(x, Expression):
            return x
        if x not in known:
            args = tuple(go(a) for a in x.args)
            known[x] = x if args == x.args else intern(x.op, *args)
        return known[x]

    out: Expression = go(e)
    return out


_UNARY_RULES: dict[str, Callable[[Expression, Expression, Expression], Expression]] = {
    "named": lambda e, x, dx: dx,
    "negative": lambda e, x, dx: -dx,
    "inverse": lambda e, x, dx: -(dx * (e * e)),
    "root": lambda e, x, dx: dx * (0.5 / e),
    "exponential": lambda e, x, dx: dx * e,
    "tanh": lambda e, x, dx: (1.0 - e * e) * dx,
    "cosine": lambda e, x, dx: -(sine(x) * dx),
    "sine": lambda e, x, dx: cosine(x) * dx,
    "abs": lambda e, x, dx: where(x > 0.0, dx, -dx),
}
"""Slope of an operation e on x, from the slope dx."""
_RULES: dict[str, Callable[..., Expression]] = {
    "where": lambda d, truth, x, y: where(truth, d(x), d(y)),
    "guarded": lambda d, truth, x: compute_where(truth, d(x)),
    "larger": lambda d, x, y: where(x > y, d(x), d(y)),
    "smaller": lambda d, x, y: where(x < y, d(x), d(y)),
    "add": lambda d, x, y: d(x) + d(y),
    "subtract": lambda d, x, y: d(x) - d(y),
    "multiply": lambda d, x, y: d(x) * y + x * d(y),
    "law": lambda d, value, *by: total(_cached_partial(value, x, by) * d(x) for x in by if d(x) is not ZERO),
}
"""The same of several, from the function d that gives the slope of each."""


def _apply_chain_rule(e: Expression, d: Callable[[Expression], Expression]) -> Expression:
    """Derivative of ``e`` along a direction, from the derivatives ``d`` of its arguments."""
    op, a = e.op, e.args
    if op in ("constant", "read", "argument", "counter"):
        return ZERO
    if op in _RULES:
        return _RULES[op](d, *a)
    if op == "newton":
        unknown, residual, steep, _ = a
        return -substitute(d(residual), {unknown: e}) / substitute(steep, {unknown: e})
    slopes_of_parts = [d(x) for x in a if isinstance(x, Expression)]
    if all(dx is ZERO for dx in slopes_of_parts):
        return ZERO
    if op not in _UNARY_RULES:
        raise TypeError(f"no derivative of {op}")
    return _UNARY_RULES[op](e, a[0], slopes_of_parts[0])
