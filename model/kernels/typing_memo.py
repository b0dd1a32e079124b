"""Compiling in less time: what numba asks again and again is answered once, or more quickly.

"What is float times float" is asked for once, not at every operation.

Numba looks through all overloads of an operator wherever it stands; in generated text of thousands of operations on
plain numbers that is a quarter of the time of compiling. ``remember_plain_numbers`` keeps what it found, by operator
and types of the arguments. Nothing is kept of arguments that are not plain numbers, and nothing where numba has another
inside than the one known here: then compiling only takes longer. docs/decisions/0151-typing-memo.md.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba.core import ir, targetconfig, types
from numba.core.types import functions

_plain: list[type] = [types.Float, types.Integer, types.Boolean]


def count_as_plain(kind: type) -> None:
    """Have types of ``kind`` count as plain numbers: those that stand for numbers alone, as rows of lanes do."""
    if kind not in _plain:
        _plain.append(kind)


def remember_plain_numbers() -> bool:
    """Have numba remember types of operations on plain numbers in this process; False where it cannot."""
    base: Any = getattr(functions, "BaseFunction", None)
    known = getattr(base, "get_call_type", None)
    if known is None:
        return False
    if getattr(known, "remembers", False):
        return True
    found: dict[tuple[int, int, tuple[Any, ...]], tuple[Any, Any]] = {}

    def get_call_type(self: Any, context: Any, args: tuple[Any, ...], kws: Any) -> Any:
        if kws or not args or not all(isinstance(one, tuple(_plain)) for one in args):
            return known(self, context, args, kws)
        # an overload that is registered later makes another number of templates
        key = id(self), len(self.templates), tuple(args)
        kept = found.get(key)
        if kept is None:
            signature = known(self, context, args, kws)
            found[key] = signature, self  # keeps it alive, so that its id stays its own
            return signature
        return kept[0]

    get_call_type.remembers = True  # type: ignore[attr-defined]
    get_call_type.asks = known  # type: ignore[attr-defined]
    base.get_call_type = get_call_type
    return True


def compare_flags_quickly() -> bool:
    """Have numba compare the options of functions by those that are set, not by all 25; False where it cannot.

    Every question about an overload compares them, and hashes their names.
    """
    kind: Any = getattr(targetconfig, "TargetConfig", None)
    if kind is None or "_values" not in getattr(kind, "__slots__", ()):
        return False
    by_all = kind.__eq__
    if getattr(by_all, "quick", False):
        return True

    def equal(self: Any, other: Any) -> Any:
        if self is other:
            return True
        if type(self) is not type(other):
            return by_all(self, other)
        one, two, options = self._values, other._values, self.options
        for name in one.keys() | two.keys():
            default = options[name].default
            if one.get(name, default) != two.get(name, default):
                return False
        return True

    equal.quick = True  # type: ignore[attr-defined]
    names_hash: Any = cache(lambda of: hash(tuple(sorted(of.options))))  # as numba's own: of the names alone
    kind.__eq__, kind.__hash__ = equal, lambda self: names_hash(type(self))
    return True


def list_variables_quickly() -> bool:
    """Have numba find the variables of an instruction by the types of its parts; False where it cannot.

    Every pass over a function asks for those of all its instructions; most parts hold none.
    """
    kind: Any = getattr(ir, "Inst", None)
    by_all = getattr(kind, "_rec_list_vars", None)
    if by_all is None:
        return False
    if getattr(by_all, "quick", False):
        return True
    holders = ir.Var, ir.Inst, list, tuple, dict
    holds: dict[type, bool] = {}

    def variables(self: Any, part: Any) -> list[Any]:
        found = []
        for one in part.values() if type(part) is dict else (part,):
            of = type(one)
            if of is ir.Var:
                found.append(one)
                continue
            if of not in holds:
                holds[of] = issubclass(of, holders)
            if holds[of]:
                found.extend(by_all(self, one))
        return found

    variables.quick = True  # type: ignore[attr-defined]
    kind._rec_list_vars = variables
    return True
