"""Numbers that are not known yet: equal ones are one object, simplified as they are made, differentiated by rule.

An element of a scene is a function of such numbers. Run once, it leaves a graph, of which forces, their derivatives by
states and by parameters, energies and what else is asked for are written out (`model.compiler.native`). Which scene and
which values plays no part here.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any, SupportsFloat

from model.errors import InputError

_made: dict[tuple[Any, ...], Expression] = {}
_count = itertools.count()
TRUTHS = ("above", "at_least", "differs", "and", "or", "not", "bit")


class Expression:
    """A number, or a truth value (see `TRUTHS`): what is done, to which others, and when it was first made."""

    __slots__ = ("args", "op", "order")

    def __init__(self, op: str, args: tuple[Any, ...]) -> None:
        self.op, self.args, self.order = op, args, next(_count)

    def __add__(self, other: Number) -> Expression:
        return _add(self, lift(other))

    def __radd__(self, other: Number) -> Expression:
        return _add(lift(other), self)

    def __sub__(self, other: Number) -> Expression:
        return _subtract(self, lift(other))

    def __rsub__(self, other: Number) -> Expression:
        return _subtract(lift(other), self)

    def __mul__(self, other: Number) -> Expression:
        return _multiply(self, lift(other))

    def __rmul__(self, other: Number) -> Expression:
        return _multiply(lift(other), self)

    def __truediv__(self, other: Number) -> Expression:
        return _divide(self, lift(other))

    def __rtruediv__(self, other: Number) -> Expression:
        return _divide(lift(other), self)

    def __neg__(self) -> Expression:
        return _negative(self)

    def __abs__(self) -> Expression:
        return make("abs", self)

    def __gt__(self, other: Number) -> Expression:
        return make("above", self, lift(other))

    def __lt__(self, other: Number) -> Expression:
        return make("above", lift(other), self)

    def __ge__(self, other: Number) -> Expression:
        return make("at_least", self, lift(other))

    def __le__(self, other: Number) -> Expression:
        return make("at_least", lift(other), self)

    def __and__(self, other: Expression) -> Expression:
        return make("and", self, other)

    def __or__(self, other: Expression) -> Expression:
        return make("or", self, other)

    def __invert__(self) -> Expression:
        return make("not", self)

    def __pow__(self, exponent: Any) -> Expression:
        if isinstance(exponent, Expression) or float(exponent) != int(exponent) or not 1 <= exponent <= MOST_FACTORS:
            raise _misuse(f"** {exponent if not isinstance(exponent, Expression) else 'an expression'}",
                    f"a whole exponent from 1 to {MOST_FACTORS}, or root(x) in place of x ** 0.5")  # fmt: skip
        product = self
        for _ in range(int(exponent) - 1):
            product = product * self
        return product

    def __rpow__(self, base: Any) -> Expression:
        raise _misuse(f"{base} ** an expression", "exponential(x)")

    def __eq__(self, other: object) -> bool:
        if isinstance(other, SupportsFloat) and not isinstance(other, Expression):
            raise _misuse("== or != between an expression and a number", "> and < in where(condition, a, b)")
        return self is other

    __hash__ = object.__hash__

    def __bool__(self) -> bool:
        raise _misuse("Python's if, and, or, not or min, max on an expression",
                "where(condition, a, b), &, |, ~, smaller(a, b), largest(a, b)")  # fmt: skip

    def __float__(self) -> float:
        raise _misuse("a function for plain numbers, as of math, on an expression",
                "root, exponential, tanh, sine and cosine of model.compiler.expressions")  # fmt: skip

    def __array_ufunc__(self, function: Any, method: str, *given: Any, **more: Any) -> Expression:
        """Numbers of NumPy beside an expression are plain ones; functions of NumPy are refused."""
        if method == "__call__" and function.__name__ in _OF_NUMPY and len(given) == 2:
            a, b = (x if isinstance(x, Expression) else float(x) for x in given)
            return _OF_NUMPY[function.__name__](lift(a), lift(b))
        raise _misuse(f"numpy.{function.__name__} on an expression",
                "root, exponential, tanh, sine, cosine, largest and smaller of model.compiler.expressions")  # fmt: skip


MOST_FACTORS = 8
"""Of a power that is written out as a product."""


def _misuse(found: str, instead: str) -> InputError:
    """The error of what Python would do with an expression at once, while its value is not known yet."""
    return InputError(f"expression: found {found}, whose value is not known yet; write {instead}")


Number = Expression | float
Given = tuple[Expression, ...]
"""What a law is differentiated by."""


def make(op: str, *args: Any) -> Expression:
    """The one expression of an operation and its arguments."""
    key = (op, *args)
    found = _made.get(key)
    if found is None:
        found = _made[key] = Expression(op, args)
    return found


def forget() -> None:
    """Let go of all expressions but the plain numbers that others are made with, once a program is written."""
    _made.clear()
    _slopes_of_laws.clear()
    _parts_of_laws.clear()
    for plain in (ZERO, ONE):
        _made[plain.op, *plain.args] = plain


def constant(x: float) -> Expression:
    """A number that is known; -0 is 0."""
    return make("constant", float(x) + 0.0)


def lift(x: Number) -> Expression:
    """A known number as an expression."""
    if isinstance(x, Expression):
        return x
    if isinstance(x, bool) or not isinstance(x, SupportsFloat):
        raise _misuse(f"{x!r} beside an expression", "a number or another expression")
    return constant(float(x))


def read(array: str, place: int, *further: Expression) -> Expression:
    """The number at a place of an array of the kernel, ``further`` whole numbers behind it."""
    return make("read", array, place, *further)


def argument(name: str) -> Expression:
    """A number that the kernel is called with."""
    return make("argument", name)


def local(name: str) -> Expression:
    """What a statement before has put to a name of the program."""
    return make("read", "local", name)


def _value(e: Expression) -> float | None:
    return e.args[0] if e.op == "constant" else None


def _add(a: Expression, b: Expression) -> Expression:
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
    return make("add", a, b) if a.order <= b.order else make("add", b, a)


def _subtract(a: Expression, b: Expression) -> Expression:
    if b is ZERO:
        return a
    if a is ZERO:
        return _negative(b)
    if a is b:
        return ZERO
    if b.op == "add" and a in b.args:  # arms: a point less the pivot that it was counted from
        return _negative(b.args[1] if b.args[0] is a else b.args[0])
    if a.op == "add" and b in a.args:
        return a.args[1] if a.args[0] is b else a.args[0]
    if a.op == "subtract" and a.args[0] is b:
        return _negative(a.args[1])
    if b.op == "subtract" and b.args[0] is a:
        return b.args[1]
    if a.op == b.op == "constant":
        return constant(a.args[0] - b.args[0])
    if b.op == "negative":
        return _add(a, b.args[0])
    if a.op == "negative":
        return _negative(_add(a.args[0], b))
    return make("subtract", a, b)


def _negative(a: Expression) -> Expression:
    if a.op == "constant":
        return constant(-a.args[0])
    if a.op == "negative":
        return a.args[0]
    if a.op == "subtract":
        return make("subtract", a.args[1], a.args[0])
    return make("negative", a)


def _multiply(a: Expression, b: Expression) -> Expression:
    if a is ZERO or b is ZERO:
        return ZERO
    if a.op == b.op == "constant":
        return constant(a.args[0] * b.args[0])
    for one, other in ((a, b), (b, a)):
        if one is ONE:
            return other
        if _value(one) == -1.0:
            return _negative(other)
        if one.op == "negative":
            return _negative(_multiply(one.args[0], other))
    return make("multiply", a, b) if a.order <= b.order else make("multiply", b, a)


def _divide(a: Expression, b: Expression) -> Expression:
    if a is ZERO:
        return ZERO
    if b is ONE:
        return a
    if b.op == "constant" and b.args[0] != 0.0:
        return _multiply(a, constant(1.0 / b.args[0]))
    return make("inverse", b) if a is ONE else _multiply(a, make("inverse", b))


_OF_NUMPY: dict[str, Callable[[Expression, Expression], Expression]] = {
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
    """Square root."""
    return make("root", a)


def exponential(a: Expression) -> Expression:
    """Exponential of a number up to 700 in size."""
    return make("exponential", a)


def power(a: Expression, exponent: Expression) -> Expression:
    """A number from 0 on to a power, by the C library; there is no rule to differentiate it."""
    return make("power", a, exponent)


def tanh(a: Expression) -> Expression:
    """Hyperbolic tangent."""
    return make("tanh", a)


def cosine(a: Expression) -> Expression:
    """Cosine."""
    return make("cosine", a)


def sine(a: Expression) -> Expression:
    """Sine."""
    return make("sine", a)


def largest(*numbers: Number) -> Expression:
    """The largest of some numbers."""
    first, *others = (lift(x) for x in numbers)
    for x in others:
        first = make("larger", first, x)
    return first


def smaller(a: Number, b: Number) -> Expression:
    """The smaller of two numbers."""
    return make("smaller", lift(a), lift(b))


def where(condition: Expression, a: Number, b: Number) -> Expression:
    """One of two numbers; both are computed."""
    a, b = lift(a), lift(b)
    return a if a is b else make("where", condition, a, b)


def guarded(condition: Expression, a: Number) -> Expression:
    """A number that is computed where the condition holds, and 0 elsewhere."""
    a = lift(a)
    return ZERO if a is ZERO else make("guarded", condition, a)


def total(terms: Iterable[Expression]) -> Expression:
    """Sum of some numbers."""
    return sum(terms, ZERO)


def law(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a law: its derivatives by its first argument, a tuple, are written once, however deep those lie.

    Without it a chain of n coordinates would differentiate the law's inside n times.
    """

    def made(given: tuple[Number, ...], *rest: Any) -> Any:
        named = tuple(x if x.op == "constant" else make("named", x) for x in map(lift, given))
        by = tuple(x for x in named if x.op == "named")
        out = function(named, *rest)
        if isinstance(out, tuple):
            return tuple(x if x.op in TRUTHS else _as_law(x, by) for x in out)
        return _as_law(out, by)

    made.__doc__ = function.__doc__
    return made


def _as_law(value: Expression, by: tuple[Expression, ...]) -> Expression:
    return make("law", value, *by) if by and value.op not in ("constant", "named") else value


def parts(wholes: Iterable[Expression], but: Iterable[Expression] = ()) -> set[Expression]:
    """Expressions, and all that they are made of, ``but`` for some and what is reached through these alone."""
    seen, todo = set(but), list(wholes)
    out = set()
    while todo:
        x = todo.pop()
        if x not in seen:
            seen.add(x)
            out.add(x)
            todo += [a for a in x.args if isinstance(a, Expression)]
    return out


def found_by_newton(unknown: Expression, residual: Expression, start: Number) -> Expression:
    """The number at which a residual, a function of ``unknown``, vanishes: Newton's iteration from ``start``."""
    return make("newton", unknown, residual, slopes({unknown: ONE})(residual), lift(start))


_slopes_of_laws: dict[tuple[Any, ...], Expression] = {}
_parts_of_laws: dict[Expression, frozenset[Expression]] = {}


def _inside(law: Expression) -> frozenset[Expression]:
    """What a law is made of beside what it is differentiated by."""
    if law not in _parts_of_laws:
        value, *by = law.args
        _parts_of_laws[law] = frozenset(parts([value], by))
    return _parts_of_laws[law]


def _slope_of_law(value: Expression, x: Expression, by: tuple[Expression, ...]) -> Expression:
    key = (value, x, by)
    if key not in _slopes_of_laws:
        _slopes_of_laws[key] = slopes({one: ONE if one is x else ZERO for one in by})(value)
    return _slopes_of_laws[key]


def slopes(along: dict[Expression, Expression]) -> Callable[[Expression], Expression]:
    """The function that differentiates along a direction: ``along`` gives what changes, and how fast."""
    known = dict(along)

    def slope(e: Expression) -> Expression:
        found = known.get(e)
        if found is None:
            found = _rule(e, slope)
            if e.op == "law" and not along.keys().isdisjoint(_inside(e)):  # a law of what changes, by itself too
                found = found + slopes(along | dict.fromkeys(e.args[1:], ZERO))(e.args[0])
            known[e] = found
        return found

    return slope


def replaced(e: Expression, by: dict[Expression, Expression]) -> Expression:
    """The expression with others in place of some of its parts."""
    known = dict(by)

    def go(x: Any) -> Any:
        if not isinstance(x, Expression):
            return x
        if x not in known:
            args = tuple(go(a) for a in x.args)
            known[x] = x if args == x.args else make(x.op, *args)
        return known[x]

    out: Expression = go(e)
    return out


_OF_ONE: dict[str, Callable[[Expression, Expression, Expression], Expression]] = {
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
_OF_MORE: dict[str, Callable[..., Expression]] = {
    "where": lambda d, truth, x, y: where(truth, d(x), d(y)),
    "guarded": lambda d, truth, x: guarded(truth, d(x)),
    "larger": lambda d, x, y: where(x > y, d(x), d(y)),
    "smaller": lambda d, x, y: where(x < y, d(x), d(y)),
    "add": lambda d, x, y: d(x) + d(y),
    "subtract": lambda d, x, y: d(x) - d(y),
    "multiply": lambda d, x, y: d(x) * y + x * d(y),
    "law": lambda d, value, *by: total(_slope_of_law(value, x, by) * d(x) for x in by if d(x) is not ZERO),
}
"""The same of several, from the function d that gives the slope of each."""


def _rule(e: Expression, d: Callable[[Expression], Expression]) -> Expression:
    op, a = e.op, e.args
    if op in ("constant", "read", "argument", "counter"):
        return ZERO
    if op in _OF_MORE:
        return _OF_MORE[op](d, *a)
    if op == "newton":
        unknown, residual, steep, _ = a
        return -replaced(d(residual), {unknown: e}) / replaced(steep, {unknown: e})
    slopes_of_parts = [d(x) for x in a if isinstance(x, Expression)]
    if all(dx is ZERO for dx in slopes_of_parts):
        return ZERO
    if op not in _OF_ONE:
        raise TypeError(f"no derivative of {op}")
    return _OF_ONE[op](e, a[0], slopes_of_parts[0])
