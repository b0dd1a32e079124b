"""Registry of the laws of felt: those of this folder, and those that a user's program adds.

A law has a number, by which a scene's tables name it. That of an added law is a hash of its text and of what that does,
so that kernels in the cache are never those of a law that was changed since.
"""

from __future__ import annotations

import hashlib
import inspect
import re
import warnings
from dataclasses import fields, is_dataclass
from typing import Any

from model.compiler.expressions import ONE, ZERO, Expression, clear_cache, differentiator
from model.elements.laws.check_law import DEEPEST_M, TRIED_ON, call_method, check_members, find_jump, locate, trace_law
from model.elements.laws.felt_law import Law
from model.elements.laws.hunt_crossley import HuntCrossley
from model.elements.laws.hysteresis import Hysteresis
from model.elements.laws.stulov import Stulov
from model.errors import InputError


class _Laws(dict[str, Law]):
    """Laws by name; what is not there is said in one line."""

    def __missing__(self, name: str) -> Law:
        raise InputError(f"felt law {name}: not known in this process; call model.add_law where your script starts")


BUILT_IN = (HuntCrossley(), Stulov(), Hysteresis())
LAWS = _Laws({law.name: law for law in BUILT_IN})
USUAL = BUILT_IN[0].name
"""Law of a contact for which no other is chosen."""
_numbered: dict[int, Law] = {}
for number, built_in in enumerate(BUILT_IN):
    built_in.number, _numbered[number] = number, built_in


def law_numbered(number: int) -> Law:
    return _numbered[number]


def add_law(law: Law) -> None:
    """Let contacts follow another law of felt, until the program ends; `InputError` for a faulty one, a warning where
    its force jumps.

    Call it where your script starts, before actions are read, so that worker processes know the law, too. A law added
    again under its name takes the place of the one before.

    Parameters
    ----------
    law : an instance of a subclass of `Law`; how to write one: docs/howto/contact_law.md

    Raises
    ------
    InputError : a name that is taken or cannot be part of a path, a number without a range that holds its usual value,
        memories whose rates hang on each other, a method that is missing, raises or returns something else, a force
        below zero or numbers that are not finite along the presses that are tried

    Warns
    -----
    UserWarning : force or rate of a memory jump along these presses; derivatives of runs that cross it are refused

    Examples
    --------
    >>> import model
    >>> from model.elements.laws.felt_law import Law
    >>> class Gel(Law):
    ...     '''Nothing is lost in it.'''
    ...     name = "gel"
    ...     def force(self, felt):
    ...         a, b, c = felt.curve
    ...         slow = ((a * felt.depth + b) * felt.depth + c) * felt.depth
    ...         return slow > 0.0, slow
    ...     def energy(self, felt, label):
    ...         a, b, c = felt.curve
    ...         x = felt.depth
    ...         return [], x * x * (0.5 * c + x * (b / 3.0 + 0.25 * a * x)), 0.0 * x
    >>> model.add_law(Gel())
    >>> model.load_action().with_laws({"contact02": "gel"}).law("contact02")
    'gel'
    """
    found = getattr(law, "name", None)
    if not isinstance(law, Law) or not isinstance(found, str) or not re.fullmatch("[a-z][a-z0-9-]*", found):
        raise InputError(
            f"felt law: found {found or law!r}, allowed an instance of Law whose name has lower-case letters, "
            "digits and hyphens"
        )
    if found in {one.name for one in BUILT_IN}:
        raise InputError(f"felt law {found}: the name of a law that is there; choose another")
    check_members(law)
    law.number = _hash(law)
    law.stamp, law.added = f"{found} {law.number}", True
    LAWS[found] = _numbered[law.number] = law
    if law.jump:
        warnings.warn(
            f"{locate(law)}: {law.jump}; runs go on, derivatives of those that cross it are refused: write a "
            "memory whose rate is continuous where felt begins to press, as stulov's is",
            stacklevel=2,
        )


def _hash(law: Law) -> int:
    """Check a law, set its ``jump``, clear the cache of expressions; return the hash of its source and expressions."""
    clear_cache()
    traced = trace_law(law)
    memory, count, rates = traced.felt.memory, len(traced.felt.memory), (traced.rates, traced.alone)
    rested = call_method(law, "rest_memories", DEEPEST_M, TRIED_ON, traced.packed, count)
    found = [len(row) for row in (*rates, rested)]
    if set(found) != {count}:
        raise InputError(
            f"felt law {law.name}: found {', '.join(map(str, found))} numbers from rates, recovery_rates, "
            f"rest_memories, allowed {count}, one for each memory"
        )
    for k, z in enumerate(memory):
        slope = differentiator({z: ONE})
        if any(slope(rate) is not ZERO for row in rates for j, rate in enumerate(row) if j != k):
            raise InputError(
                f"felt law {law.name}: found a memory whose rate hangs on another, allowed rates of the own state; "
                "write it as layers side by side"
            )
    law.jump = find_jump(law, traced)
    pair = traced.pressing, traced.force
    done = pair, rates, traced.energy, traced.stiffness, law.anew, law.damped
    try:
        text = inspect.getsource(type(law))
    except (OSError, TypeError):  # written at a prompt
        text = ""
    digest = hashlib.sha256((text + _spell_out(done)).encode()).digest()
    clear_cache()
    return int.from_bytes(digest[:7], "big") + len(BUILT_IN)


def _spell_out(things: Any) -> str:
    """Expressions and statements as text: equal where they do the same."""
    place: dict[Expression, int] = {}
    lines: list[str] = []

    def word(x: Any) -> str:
        if isinstance(x, Expression):
            if x not in place:
                lines.append(f"{x.op} {' '.join(word(a) for a in x.args)}")
                place[x] = len(place)
            return f"%{place[x]}"
        if is_dataclass(x):
            return type(x).__name__ + word([getattr(x, f.name) for f in fields(x)])
        return f"({' '.join(word(part) for part in x)})" if isinstance(x, list | tuple) else repr(x)

    lines.append(word(things))
    return "\n".join(lines)
