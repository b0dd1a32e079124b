"""Checks of a user's force law when it is added: what its methods return, and how its force and rates behave.

The law is evaluated along presses at three speeds, each pressed, parted and pressed again. Found are a force below
zero, a number that is not finite, and a jump of force or rate across any condition that a press crosses.
"""

from __future__ import annotations

import inspect
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from model.compiler.expressions import ONE, TRUTHS, Expression, argument, as_expression, differentiator, subexpressions
from model.elements.laws.felt_law import Felt, Law, Number
from model.errors import InputError

MOST_MEMORIES = 3
"""Of one felt: the workspace of a step has room for so many at each of thirteen contacts."""
TRIED_ON = (1e10, 1e7, 1e4)
"""A loading curve that no law refuses: a, b, c in N/m^3, N/m^2, N/m; 30 N at a millimetre."""
DEEPEST_M = 1e-3  # m, of a felt that a hammer or a hand presses
SWING_M = 0.55 * DEEPEST_M  # half of the way from a tenth of that outside the felt to it
SPEEDS_M_PER_S = (0.01, 0.3, 3.0)
"""From a slow press to the speed of a hammer at the string."""
STEPS = 320
"""Of one press, of two periods; a condition that holds for less than 1/160 of a period may be passed over."""
JUMP = 1e-6
"""A change across a condition, in the largest value of a press, beyond which it is a jump; rounding makes 1e-9."""

_SYMBOL = r"(kg|m|s|N|J|W|Pa|rad|Hz|K|A|V|C|H|ohm)(\^-?\d(\.\d+)?)?"
UNIT = re.compile(rf"(1|{_SYMBOL})([*/]{_SYMBOL})*")


class Traced(NamedTuple):
    """What the methods of a law returned for symbolic felt, and that felt."""

    felt: Felt
    pressing: Expression
    force: Expression
    rates: tuple[Expression, ...]
    alone: tuple[Expression, ...]
    packed: tuple[float, ...]
    energy: tuple[Any, ...]
    stiffness: Any


def locate(law: Law) -> str:
    """Text of file and line of a law's class, or its name."""
    for kind in type(law).__mro__:  # of a class that was made by a call, the one that it was made of
        if kind is not type(law) and kind.__module__.startswith("model."):
            break
        try:
            file = inspect.getsourcefile(kind) or "<unknown>"
            return f"{file}, line {inspect.getsourcelines(kind)[1]}: felt law {law.name}"
        except (OSError, TypeError):  # written at a prompt
            continue
    return f"felt law {law.name}"


def call_method(law: Law, method: str, *arguments: Any) -> Any:
    """Return what a method of a law returns; any error in it becomes an `InputError` of one line that names law and
    method."""
    try:
        return getattr(law, method)(*arguments)
    except InputError as error:
        if str(error).startswith("expression: "):
            raise InputError(f"{locate(law)}: {method}: {str(error).removeprefix('expression: ')}") from None
        raise
    except NotImplementedError:
        needed = {
            "force": "return whether the felt presses and its force, e.g. (slow > 0.0, slow)",
            "energy": "return statements, the energy stored in J and the power lost in W",
        }
        raise InputError(f"{locate(law)}: {method} is missing; {needed.get(method, 'write it')}") from None
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{locate(law)}: {method}: {type(error).__name__}: {reason}; calculate with felt.depth, felt.rate, "
            "felt.memory, felt.curve and felt.numbers and the functions of model.compiler.expressions"
        ) from None


def _check_number(law: Law, what: str, value: Any) -> Expression:
    """Return a law's value as an expression; `InputError`, naming ``what`` it is, for anything that is no number."""
    if isinstance(value, bool) or not isinstance(value, Expression | int | float):
        raise InputError(f"{locate(law)}: {what}: found {_show(value)}, allowed an expression of felt or a number")
    found = as_expression(value)
    if found.op in TRUTHS:
        raise InputError(f"{locate(law)}: {what}: found a condition, allowed a number; write where(condition, a, b)")
    return found


def _check_expression(law: Law, what: str, value: Any) -> Expression:
    """Return a law's value; `InputError`, naming ``what`` it is, for a plain number, which no kernel can
    differentiate."""
    found = _check_number(law, what, value)
    if not isinstance(value, Expression):
        raise InputError(
            f"{locate(law)}: {what}: found the plain number {value!r}, allowed an expression; write {value!r} * ONE, "
            "or ZERO, of model.compiler.expressions"
        )
    return found


def _show(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 and " object at " not in text else f"a {type(value).__name__}"


def check_members(law: Law) -> None:
    """Refuse a law whose attributes have a wrong type, name or range; the error names the attribute."""
    for former, name in {"packed": "pack_numbers", "alone": "recovery_rates", "rested": "rest_memories"}.items():
        if hasattr(law, former):
            raise InputError(f"{locate(law)}: {former}: this method is now called {name}; rename it")
    if not isinstance(law.damped, bool):
        raise InputError(f"{locate(law)}: damped: found {_show(law.damped)}, allowed True or False")
    if law.anew is not None and not _is_finite(law.anew):
        raise InputError(f"{locate(law)}: anew: found {_show(law.anew)}, allowed a finite number or None")
    if not isinstance(law.numbers, Mapping):
        raise InputError(f"{locate(law)}: numbers: found {_show(law.numbers)}, allowed a dict of Number by name")
    for name, n in law.numbers.items():
        if not (isinstance(name, str) and name.isidentifier() and name.isascii()):
            raise InputError(
                f"{locate(law)}: numbers: found {name!r}, allowed a name of letters, digits and _, for paths such as "
                f"contact02.{law.name}.k"
            )
        if not isinstance(n, Number) or not all(map(_is_finite, (n.value, n.u))):
            raise InputError(
                f"{locate(law)}: {name}: found {n}, allowed a Number with low <= value <= high, u from 0: "
                "Number(value, unit, u, low, high, source)"
            )
        if not isinstance(n.unit, str) or not UNIT.fullmatch(n.unit):
            raise InputError(
                f'{locate(law)}: {name}: found the unit {n.unit!r}, allowed one of SI without prefix, such as "1", '
                '"s/m", "N/m^2", "kg*m^2"'
            )
        if not (n.low <= n.value <= n.high and n.u >= 0.0):
            raise InputError(f"{locate(law)}: {name}: found {n}, allowed a Number with low <= value <= high, u from 0")


def _is_finite(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)


def trace_law(law: Law) -> Traced:
    """What the methods of a law return for a felt whose depth, rate and numbers are symbols, and that felt;
    `InputError` where something is not of the form it must have."""
    usual = {name: n.value for name, n in law.numbers.items()}
    given = call_method(law, "pack_numbers", "contact01", usual, TRIED_ON)
    try:
        count, packed = int(given[0]), tuple(float(x) for x in given[1])
    except (TypeError, ValueError, LookupError):
        raise InputError(
            f"{locate(law)}: pack_numbers: found {_show(given)}, allowed the number of memories and a row of numbers"
        ) from None
    if not 0 <= count <= MOST_MEMORIES:
        raise InputError(f"felt law {law.name}: found {count} memories, allowed to {MOST_MEMORIES}")
    memory = tuple(argument(f"memory {k}") for k in range(count))
    curve = argument("a"), argument("b"), argument("c")
    numbers = tuple(argument(f"number {k}") for k in range(len(packed)))
    felt = Felt(argument("depth"), argument("rate"), memory, curve, argument("damping"), numbers)
    pressing, force = _check_force(law, call_method(law, "force", felt))
    rates, alone = (_check_rates(law, method, call_method(law, method, felt)) for method in ("rates", "recovery_rates"))
    energy = call_method(law, "energy", felt, "")
    if not isinstance(energy, tuple | list) or len(energy) != 3 or not isinstance(energy[0], list | tuple):
        raise InputError(
            f"{locate(law)}: energy: found {_show(energy)}, allowed a list of statements (or []), the energy stored "
            "in J and the power lost in W"
        )
    for what, value in zip(("energy stored", "power lost"), energy[1:], strict=True):
        _check_expression(law, f"energy: {what}", value)
    stiffness = call_method(law, "stiffness", felt)
    _check_number(law, "stiffness", stiffness)
    _check_derivatives(law, felt, (force, *rates, *alone))
    return Traced(felt, pressing, force, rates, alone, packed, tuple(energy), stiffness)


def _check_force(law: Law, given: Any) -> tuple[Expression, Expression]:
    """Condition of pressing and force (N) that a law returned; `InputError` where they are not such a pair."""
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise InputError(
            f"{locate(law)}: force: found {_show(given)}, allowed a pair: whether the felt presses, and its force "
            "in N, e.g. (slow > 0.0, slow)"
        )
    pressing, force = given
    if not isinstance(pressing, Expression) or pressing.op not in TRUTHS:
        raise InputError(
            f"{locate(law)}: force: whether it presses: found {_show(pressing)}, allowed a condition on the felt, "
            "e.g. slow > 0.0, joined by & and |"
        )
    found = _check_number(law, "force", force)
    if found.op == "constant":
        raise InputError(
            f"{locate(law)}: force: found the number {found.args[0]:g} N for every depth, allowed a force that grows "
            "from 0 with felt.depth"
        )
    return pressing, found


def _check_rates(law: Law, method: str, given: Any) -> tuple[Expression, ...]:
    if isinstance(given, Expression) or not isinstance(given, Sequence):
        raise InputError(f"{locate(law)}: {method}: found {_show(given)}, allowed a list, one rate for each memory")
    return tuple(_check_expression(law, f"{method}: rate of memory {k + 1}", rate) for k, rate in enumerate(given))


def _check_derivatives(law: Law, felt: Felt, wholes: Sequence[Expression]) -> None:
    """Refuse a law whose expressions ``wholes`` have no derivative by depth, rate or an internal variable."""
    for by in (felt.depth, felt.rate, *felt.memory):
        slope = differentiator({by: ONE})
        for whole in wholes:
            try:
                slope(whole)
            except TypeError:
                raise InputError(
                    f"{locate(law)}: force or rates hold power(), which has no derivative by depth, rate or memory; "
                    "write products, root() or exponential()"
                ) from None


_VALUE_OF: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "negative": operator.neg,
    "inverse": lambda x: 1.0 / x,
    "abs": abs,
    "root": math.sqrt,
    "exponential": math.exp,
    "power": math.pow,
    "tanh": math.tanh,
    "cosine": math.cos,
    "sine": math.sin,
    "larger": max,
    "smaller": min,
    "where": lambda truth, x, y: x if truth else y,
    "guarded": lambda truth, x: x if truth else 0.0,
    "named": lambda x: x,
    "law": lambda value, *by: value,
    "above": operator.gt,
    "at_least": operator.ge,
    "differs": operator.ne,
    "and": lambda x, y: x and y,
    "or": lambda x, y: x or y,
    "not": operator.not_,
}


def compile_values(wholes: Sequence[Expression]) -> Callable[[dict[Expression, float]], dict[Expression, Any]]:
    """Return a function from the values of arguments to those of all parts; not a number where one cannot be."""
    ordered = sorted(subexpressions(wholes), key=lambda e: e.order)  # an expression is made after its arguments

    def evaluate(given: dict[Expression, float]) -> dict[Expression, Any]:
        value: dict[Expression, Any] = dict(given)
        for e in ordered:
            if e in value:
                continue
            if e.op == "constant":
                value[e] = e.args[0]
                continue
            try:
                value[e] = _VALUE_OF[e.op](*(value[a] for a in e.args))
            except (ArithmeticError, ValueError):
                value[e] = math.nan
        return value

    return evaluate


class _State(NamedTuple):
    """Depth (m), rate (m/s) and memories of felt."""

    depth: float
    rate: float
    memory: tuple[float, ...]


class _Press:
    """One press of a traced law: its force, rates and conditions at any state."""

    def __init__(self, law: Law, traced: Traced) -> None:
        self.law, self.traced = law, traced
        wholes = (traced.pressing, traced.force, *traced.rates, *traced.alone)
        self._evaluate = compile_values(wholes)
        self._conditions = [e for e in subexpressions(wholes) if e.op in ("above", "at_least", "differs")]
        felt = traced.felt
        self._fixed = {
            **dict(zip(felt.curve, TRIED_ON, strict=True)),
            **dict(zip(felt.numbers, traced.packed, strict=True)),
            felt.damping: 1.0 if law.damped else 0.0,
        }

    def evaluate(self, state: _State) -> tuple[float, tuple[float, ...], tuple[bool, ...]]:
        """Force (N; 0 where open), rates of the internal variables (per s) and which conditions hold, touching and
        pressing first, at a state."""
        felt = self.traced.felt
        given = {**self._fixed, felt.depth: state.depth, felt.rate: state.rate}
        value = self._evaluate(given | dict(zip(felt.memory, state.memory, strict=True)))
        touching = state.depth > 0.0
        pressed = touching and bool(value[self.traced.pressing])
        force = value[self.traced.force] if pressed else 0.0
        if pressed or self.law.anew is None:
            rates = tuple(value[rate] for rate in (self.traced.rates if pressed else self.traced.alone))
        else:
            rates = (0.0,) * len(state.memory)
        # beside a contact that is open, conditions of the pressed law mean nothing
        holds = (touching, pressed, *(bool(value[c]) for c in self._conditions)) if touching else (False, False)
        return force, rates, holds

    def step(self, before: _State, depth: float, rate: float, dt: float) -> _State:
        """State at another depth (m) and rate (m/s), a time ``dt`` (s) later, its internal variables advanced by the
        implicit Euler method."""
        if self.law.anew is not None and not self.evaluate(_State(depth, rate, before.memory))[2][1]:
            return _State(depth, rate, (self.law.anew,) * len(before.memory))
        memory = list(before.memory)
        for k, start in enumerate(before.memory):

            def residual(z: float, k: int = k, start: float = start) -> float:
                trial = tuple(z if j == k else x for j, x in enumerate(memory))
                return z - start - dt * float(self.evaluate(_State(depth, rate, trial))[1][k])

            z, step = start, 1e-6 * (1.0 + abs(start))
            for _ in range(12):
                off = residual(z)
                slope = (residual(z + step) - off) / step
                move = -off / slope if math.isfinite(slope) and slope != 0.0 else 0.0
                z += move
                if abs(move) <= JUMP**2 * (1.0 + abs(z)):
                    break
            memory[k] = z
        return _State(depth, rate, tuple(memory))


def find_jump(law: Law, traced: Traced) -> str:
    """Press a felt that follows the law at several speeds; return words on where its force or rates jump first, empty
    where they do not; `InputError` where they are not finite or the felt pulls."""
    press = _Press(law, traced)
    found = ""
    resting = [
        _State(
            depth,
            0.0,
            tuple(call_method(law, "rest_memories", depth, TRIED_ON, traced.packed, len(traced.felt.memory))),
        )
        for depth in (1e-6 * DEEPEST_M, 1e-3 * DEEPEST_M, DEEPEST_M)
    ]
    _refuse_impossible(law, resting, [press.evaluate(state) for state in resting])
    for speed in SPEEDS_M_PER_S:
        states = _pressed_states(press, speed)
        seen = [press.evaluate(state) for state in states]
        _refuse_impossible(law, states, seen)
        by_memory = zip(*(rates for _, rates, _ in seen), strict=True)
        most = max(abs(force) for force, _, _ in seen), [max(map(abs, rates)) for rates in by_memory]
        for k in range(STEPS):
            if seen[k][2] != seen[k + 1][2] and not found:
                found = _jump_between(press, (states[k], states[k + 1]), most)
    return found


def _pressed_states(press: _Press, speed: float) -> list[_State]:
    """States of felt pressed twice from outside to `DEEPEST_M` and back, at most ``speed`` (m/s) fast."""
    period = 2.0 * math.pi * SWING_M / speed
    dt = 2.0 * period / STEPS
    count = len(press.traced.felt.memory)
    memory = (press.law.anew if press.law.anew is not None else 0.0,) * count
    # from a tenth of the depth outside the felt to the deepest point and back
    states = [_State(-0.1 * DEEPEST_M, 0.0, memory)]
    for k in range(1, STEPS + 1):
        turn = 2.0 * math.pi * k * dt / period
        depth, rate = DEEPEST_M - SWING_M * (1.0 + math.cos(turn)), speed * math.sin(turn)
        states.append(press.step(states[-1], depth, rate, dt))
    return states


def _refuse_impossible(law: Law, states: Sequence[_State], seen: Sequence[Any]) -> None:
    """Refuse a law whose force or rates, evaluated as ``seen`` at ``states``, are not finite or pull."""
    largest = max(abs(force) for force, _, _ in seen)
    for state, (force, rates, _) in zip(states, seen, strict=True):
        where = f"at depth {1e3 * state.depth:.3g} mm and rate {state.rate:.3g} m/s"
        if not all(map(math.isfinite, (force, *rates))):
            raise InputError(
                f"{locate(law)}: force or rates are not finite {where}; keep each division from zero, e.g. by "
                "where(x > 0.0, x, 1.0), and each root from below it"
            )
        if force < -1e-9 * largest:
            raise InputError(
                f"{locate(law)}: force {force:.3g} N {where}, allowed from 0: felt never pulls; say that it does not "
                "press there, e.g. force > 0.0"
            )


def _jump_between(press: _Press, ends: tuple[_State, _State], magnitude: tuple[float, list[float]]) -> str:
    """Bisect between two states for each condition that changes; return the first discontinuity of force or rate."""
    a, b = ends
    meets = a.depth <= 0.0 < b.depth  # memories are those of the open felt until it is touched

    def interpolate(share: float) -> _State:
        memory = a.memory if meets else tuple(x + share * (y - x) for x, y in zip(a.memory, b.memory, strict=True))
        return _State(a.depth + share * (b.depth - a.depth), a.rate + share * (b.rate - a.rate), memory)

    low, high, at_low = 0.0, 1.0, press.evaluate(a)
    for _ in range(60):
        middle = 0.5 * (low + high)
        here = press.evaluate(interpolate(middle))
        if here[2] == at_low[2]:
            low, at_low = middle, here
        else:
            high = middle
    at_high, state = press.evaluate(interpolate(high)), interpolate(high)
    where = f"at depth {1e3 * state.depth:.3g} mm and rate {state.rate:.3g} m/s"
    if abs(at_high[0] - at_low[0]) > JUMP * magnitude[0]:
        return f"its force jumps by {at_high[0] - at_low[0]:.3g} N {where}"
    if press.law.anew is not None and not at_high[2][1]:
        return ""  # parted, its memory starts anew whatever the rate was
    for k, (x, y, largest) in enumerate(zip(at_low[1], at_high[1], magnitude[1], strict=True)):
        if abs(y - x) > JUMP * largest:
            return f"the rate of memory {k + 1} jumps by {y - x:.3g} {where}"
    return ""
