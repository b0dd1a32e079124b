"""Compiling in less time: "what is float times float" is asked for once, not at every operation.

Numba looks through all overloads of an operator wherever it stands: a tenth of the time of compiling a step loop
(docs/explanation/house.md). ``remember_plain_numbers`` keeps what it found, by operator and types of the arguments.
Nothing is kept of arguments that are not plain numbers, and nothing where numba has another inside than the one known
here: then compiling only takes longer.
"""

from __future__ import annotations

from typing import Any

from numba.core import types
from numba.core.types import functions

PLAIN = types.Float, types.Integer, types.Boolean


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
        if kws or not args or not all(isinstance(one, PLAIN) for one in args):
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
