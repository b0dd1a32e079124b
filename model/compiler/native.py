"""Lowering of programs to LLVM's intermediate representation, for one run or for lanes.

In lanes each entry of an array is a row with a number per lane; where a condition decides, a block runs if any lane
needs it, and what it writes reaches those lanes alone. Products may be rounded once with the sum that they stand in;
nothing else is reordered.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from model.compiler import elementary
from model.compiler.expressions import Expression, intern
from model.compiler.programs import Accumulate, Assign, ClearMask, Compute, For, If, Place, Reload, Statement, While

DOUBLE, TRUTH, INTEGER, SHORT = ir.DoubleType(), ir.IntType(1), ir.IntType(64), ir.IntType(32)
BUNDLE = 8  # like expressions of one run computed side by side
NEWTON_STEPS, NEWTON_SHARE = 30, 1e-14
# a quotient is rounded once, where a product with the inverse is twice
ROUNDED = {"add": "fadd", "subtract": "fsub", "multiply": "fmul", "negative": "fneg", "quotient": "fdiv"}
CHOSEN = {"where": "select", "and": "and_", "or": "or_", "not": "not_"}
INTRINSICS = {"root": "sqrt", "abs": "fabs", "fused": "fmuladd", "with_sign": "copysign", "power": "pow"}
COMPARED = {"above": ">", "at_least": ">=", "differs": "!="}


def broadcast(b: ir.IRBuilder, value: Any, width: int) -> Any:
    """LLVM vector of ``width`` lanes with ``value`` in each."""
    kind = ir.VectorType(value.type, width)
    if isinstance(value, ir.Constant):
        return ir.Constant(kind, [value.constant] * width)
    first = b.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(SHORT, 0))
    return b.shuffle_vector(first, ir.Constant(kind, ir.Undefined), ir.Constant(ir.VectorType(SHORT, width), None))


def call_intrinsic(b: ir.IRBuilder, name: str, *values: Any) -> Any:
    """LLVM value of the intrinsic ``name`` of scalars or vectors."""
    kind = values[0].type
    full = f"llvm.{name}." + ("f64" if kind == DOUBLE else f"v{kind.count}f64")
    function = b.module.globals.get(full) or ir.Function(b.module, ir.FunctionType(kind, [kind] * len(values)), full)
    return b.call(function, values)


class _ValueScope:
    """Values that expressions have in a block and in those around it."""

    def __init__(self, around: _ValueScope | None = None, changing: set[Any] | None = None) -> None:
        self.around, self.here = around, {}  # type: ignore[var-annotated]
        self.changing = changing or set()
        self._changes: dict[Expression, bool] = {}

    def get(self, e: Expression) -> Any:
        found = self.here.get(e)
        if found is None and self.around is not None and not (self.changing and self.reads_changing(e)):
            found = self.around.get(e)
        return found

    def reads_changing(self, e: Expression) -> bool:
        if e not in self._changes:
            read = e.op == "read" and (e.args[0] in self.changing or (e.args[0], e.args[1]) in self.changing)
            parts = [a for a in e.args if isinstance(a, Expression)]
            self._changes[e] = read or e in self.changing or any(self.reads_changing(a) for a in parts)
        return self._changes[e]


def _modified_places(statements: list[Statement]) -> set[Any]:
    """Places that statements change: arrays as a whole, and variables."""
    out: set[Any] = set()
    for s in statements:
        if isinstance(s, Assign | Accumulate):
            out.add(s.place[:2] if s.place[0] == "local" else s.place[0])
        elif isinstance(s, If):
            out |= _modified_places(s.then) | _modified_places(s.otherwise)
        elif isinstance(s, For | While):
            out |= _modified_places(s.body)
    return out


class KernelWriter:
    """One kernel under way.

    Parameters
    ----------
    module : LLVM module that it becomes part of
    name : of its function
    arguments : name and kind of each: ``array`` (in lanes of rows), ``plain`` array of numbers, ``number``, ``whole``
    lanes : members side by side
    bundles : whether the processor gains by computing like expressions of one run in a vector
    exact : whether each operation is rounded by itself
    """

    def __init__(
        self,
        module: ir.Module,
        name: str,
        arguments: dict[str, str],
        lanes: int = 1,
        bundles: bool = False,
        exact: bool = False,
    ) -> None:
        kinds = {"array": DOUBLE.as_pointer(), "plain": DOUBLE.as_pointer(), "number": DOUBLE, "whole": INTEGER}
        self._function = ir.Function(module, ir.FunctionType(INTEGER, [kinds[k] for k in arguments.values()]), name)
        for given, kind in zip(self._function.args, arguments.values(), strict=True):
            if kind in ("array", "plain"):
                given.add_attribute("noalias")
        self._flat = {a for a, kind in arguments.items() if kind == "plain"}
        self._given = dict(zip(arguments, self._function.args, strict=True))
        self.b = ir.IRBuilder(self._function.append_basic_block("entry"))
        self._body = self._function.append_basic_block("body")
        self._start = self.b.branch(self._body)
        self.b.position_at_end(self._body)
        self.lanes, self._bundles = lanes, bundles and lanes == 1
        self._width = lanes
        self._flags = () if exact else ("contract", "nsz")
        self._names: dict[str, Any] = {}
        self._known = _ValueScope()
        self.mask = self._given.get("mask")
        self.exceeded: Any = None

    # what is written ---------------------------------------------------------------------------------------------

    def write(self, statements: list[Statement], where: Any = None) -> None:
        """Write code of statements; ``where`` is the mask of lanes that take part (None: all)."""
        for s in statements:
            if isinstance(s, Assign | Accumulate):
                self._write_assignment(s, where)
            elif isinstance(s, Compute):
                self._compute_values([e for e in s.values if self._known.get(e) is None], s.alike)
            elif isinstance(s, If):
                self._write_branch(s, where)
            elif isinstance(s, Reload):
                self._known = _ValueScope()
            elif isinstance(s, ClearMask):
                self.exceeded = self.value(s.condition)
                self.mask = self.b.select(self._any_lane(self.exceeded), ir.Constant(INTEGER, 0), self.mask)
            else:
                self._write_loop(s, where)

    def bits(self, truth: Any) -> Any:
        """LLVM integer of a truth value: 0 or 1; of lanes one bit each."""
        if self.lanes > 1:
            truth = self.b.bitcast(truth, ir.IntType(self.lanes))
        return self.b.zext(truth, INTEGER)

    def mask_of(self, conditions: list[tuple[int, Expression]]) -> Any:
        """Bit ``k`` where condition ``k`` does not hold, in lanes where it holds in none."""
        out = ir.Constant(INTEGER, 0)
        for k, condition in conditions:
            fails = self.b.not_(self._any_lane(self.value(condition)))
            out = self.b.or_(out, self.b.shl(self.b.zext(fails, INTEGER), ir.Constant(INTEGER, k)))
        return out

    def count(self, name: str) -> Any:
        """LLVM integer of the counting variable ``name``; of lanes that of the first."""
        value = self.b.load(self._name(name))
        if self.lanes > 1:
            value = self.b.extract_element(value, ir.Constant(SHORT, 0))
        return self.b.fptosi(value, INTEGER)

    def end(self, result: Any = None) -> None:
        """End the kernel: write the return of an integer."""
        self.b.ret(ir.Constant(INTEGER, 0) if result is None else result)

    # statements --------------------------------------------------------------------------------------------------

    def _write_assignment(self, s: Assign | Accumulate, where: Any) -> None:
        """Write code that stores or adds a value, only in the lanes of ``where`` (None: in all)."""
        value, pointer = self.value(s.value), self._pointer(s.place)
        if isinstance(s, Accumulate):
            if where is not None:  # adding -0 changes no bit
                value = self.b.select(where, value, self._number(-0.0))
            value = self.b.fadd(self.b.load(pointer, align=8), value, flags=self._flags)
        elif where is not None:
            value = self.b.select(where, value, self.b.load(pointer, align=8))
        self.b.store(value, pointer, align=8)

    def _write_branch(self, s: If, where: Any) -> None:
        """Write code of an If, a branch in lanes that take it; ``where`` are the lanes that take part (None: all)."""
        truth = self.value(s.condition)
        uniform = self.lanes == 1 or truth.type == TRUTH
        if uniform:
            if not s.otherwise:
                with self.b.if_then(truth), self._block():
                    self.write(s.then, where)
                return
            with self.b.if_else(truth) as (then, otherwise):
                for part, statements in zip((then, otherwise), (s.then, s.otherwise), strict=True):
                    with part, self._block():
                        self.write(statements, where)
            return
        for mine, statements in ((truth, s.then), (self.b.not_(truth), s.otherwise)):
            if statements:
                here = mine if where is None else self.b.and_(where, mine)
                with self.b.if_then(self._any_lane(here)), self._block():
                    self.write(statements, here)

    def _write_loop(self, s: For | While, where: Any) -> None:
        """Write code of a For or While; ``where`` are the lanes that take part (None: all)."""
        around, changing = self.b.block, _modified_places(s.body)
        head, body, after = (self._function.append_basic_block(n) for n in ("head", "loop", "after"))
        counter: Any = None
        if isinstance(s, For):
            count = self._integer_value(s.count)
            self.b.branch(head)
            self.b.position_at_end(head)
            counter = self.b.phi(INTEGER)
            counter.add_incoming(ir.Constant(INTEGER, 0), around)
            go_on, here = self.b.icmp_signed("<", counter, count), where
        with self._block(changing):
            if isinstance(s, For):
                self._known.here[s.counter] = counter
            else:
                self.b.branch(head)
                self.b.position_at_end(head)
                truth = self.value(s.condition)
                here = truth if self.lanes > 1 else None
                if here is not None and where is not None:
                    here = self.b.and_(here, where)
                go_on = self._any_lane(truth if here is None else here)
            self.b.cbranch(go_on, body, after)
            self.b.position_at_end(body)
            with self._block():
                self.write(s.body, here)
            if counter is not None:
                counter.add_incoming(self.b.add(counter, ir.Constant(INTEGER, 1)), self.b.block)
            self.b.branch(head)
        self.b.position_at_end(after)

    @contextmanager
    def _block(self, changing: set[Any] | None = None) -> Iterator[None]:
        around = self._known
        self._known = _ValueScope(around, changing)
        yield
        self._known = around

    # values ------------------------------------------------------------------------------------------------------

    def value(self, e: Expression) -> Any:
        """The LLVM value of an expression, computed here unless a block around has it."""
        known = self._known
        found = known.get(e)
        if found is not None:
            return found
        todo = [e]
        while todo:
            x = todo[-1]
            if known.get(x) is not None:
                todo.pop()
                continue
            needed = x.args[:1] if x.op in ("guarded", "law") else () if x.op == "newton" else x.args
            missing = [a for a in needed if isinstance(a, Expression) and known.get(a) is None]
            if missing:
                todo += missing
                continue
            known.here[x] = self._operation(x, [known.get(a) if isinstance(a, Expression) else a for a in x.args])
            todo.pop()
        return known.get(e)

    def _operation(self, e: Expression, a: list[Any]) -> Any:
        """LLVM value of one operation with the values ``a`` of its arguments; writes its code here."""
        b, op = self.b, e.op
        if op in ("named", "law"):
            return a[0]
        if op == "constant":
            return self._number(a[0])
        if op == "argument":
            given = self._given[a[0]]
            return given if self.lanes == 1 or given.type == INTEGER else broadcast(self.b, given, self.lanes)
        if op == "read" and e.args[0] in self._flat:
            index = ir.Constant(INTEGER, e.args[1]) if len(a) < 3 else b.add(ir.Constant(INTEGER, e.args[1]), a[2])
            number = b.load(b.gep(self._given[e.args[0]], [index]), align=8)
            return number if self.lanes == 1 else broadcast(self.b, number, self.lanes)
        if op == "read" and len(a) > 2 and self._is_per_lane(a[2]):
            return self._gather(*a)
        if op == "read":
            return b.load(self._pointer((e.args[0], e.args[1], e.args[2] if len(e.args) > 2 else None)), align=8)
        if op == "whole":
            return self._integer_value(e.args[0])
        if op == "whole_per_lane":
            return b.fptosi(a[0], INTEGER if self.lanes == 1 else ir.VectorType(INTEGER, self.lanes))
        if op in ("whole_add", "whole_multiply"):
            return (b.add if op == "whole_add" else b.mul)(*self._integers(a))
        if op == "first":
            return b.icmp_signed("==", self._given["k"], ir.Constant(INTEGER, 0))
        if op == "bit":
            held = b.and_(b.lshr(self.mask, ir.Constant(INTEGER, a[0])), ir.Constant(INTEGER, 1))
            return b.icmp_signed("==", held, ir.Constant(INTEGER, 0))
        if op in ("cosine", "sine"):
            return self._lower_rotation([e])[op]
        if op == "guarded":
            return self._lower_conditional(a[0], lambda: self.value(e.args[1]))
        if op == "newton":
            return self._lower_newton(e)
        if op in elementary.WRITTEN:
            return self.value(elementary.WRITTEN[op](*e.args))
        return self._lower_arithmetic(op, a)

    def _lower_arithmetic(self, op: str, a: list[Any]) -> Any:
        """LLVM value of an arithmetic operation or comparison ``op`` with the values ``a``."""
        b = self.b
        if op in ROUNDED:
            return getattr(b, ROUNDED[op])(*a, flags=self._flags)
        if op in CHOSEN:
            return getattr(b, CHOSEN[op])(*a)
        if op in COMPARED:
            compare = b.fcmp_unordered if op == "differs" else b.fcmp_ordered
            return compare(COMPARED[op], *a)
        if op == "inverse":
            return b.fdiv(self._number(1.0), a[0], flags=self._flags)
        if op in ("larger", "smaller"):
            return b.select(b.fcmp_ordered(">" if op == "larger" else "<", *a), *a)
        if op == "two_to":  # of a whole number that stands in the last bits of its sum with `elementary.ROUND`
            kind = INTEGER if self._width == 1 else ir.VectorType(INTEGER, self._width)
            whole = b.shl(b.bitcast(a[0], kind), self._splat_of(kind, 52))
            return b.bitcast(b.add(whole, self._splat_of(kind, 1023 << 52)), self._kind)
        return call_intrinsic(self.b, INTRINSICS[op], *a)

    def _lower_conditional(self, truth: Any, compute: Any) -> Any:
        """LLVM value of ``compute()`` where ``truth`` holds, else 0; computed in a block of its own."""
        before = self.b.block
        with self.b.if_then(self._any_lane(truth)):
            with self._block():
                value = compute()
            if value.type != DOUBLE and truth.type != TRUTH:
                value = self.b.select(truth, value, self._number(0.0))
            there = self.b.block
        out = self.b.phi(value.type)
        out.add_incoming(self._number(0.0), before)
        out.add_incoming(value, there)
        return out

    def _lower_newton(self, e: Expression) -> Any:
        """LLVM value of the root of a residual, by Newton's method in a loop, each lane until it has converged."""
        unknown, residual, steep, start = e.args
        b, first, around = self.b, self.value(start), self.b.block
        head, after = (self._function.append_basic_block(n) for n in ("newton", "found"))
        b.branch(head)
        b.position_at_end(head)
        f, n = b.phi(self._kind), b.phi(INTEGER)
        truth = TRUTH if self._width == 1 else ir.VectorType(TRUTH, self._width)
        looking = b.phi(truth)  # a lane that has found its root goes on no further with the others
        looking.add_incoming(ir.Constant(truth, 1 if self._width == 1 else [1] * self._width), around)
        f.add_incoming(first, around)
        n.add_incoming(ir.Constant(INTEGER, 0), around)
        with self._block({unknown}):
            self._known.here[unknown] = f
            step = b.fdiv(self.value(residual), self.value(steep), flags=self._flags)
        better = b.select(looking, b.fsub(f, step, flags=self._flags), f)
        size, share = call_intrinsic(self.b, "fabs", step), call_intrinsic(self.b, "fabs", better)
        off = b.and_(looking, b.fcmp_ordered(">", size, b.fmul(self._number(NEWTON_SHARE), share)))
        looking.add_incoming(off, b.block)
        more = b.add(n, ir.Constant(INTEGER, 1))
        go_on = b.and_(self._any_lane(off), b.icmp_signed("<", more, ir.Constant(INTEGER, NEWTON_STEPS)))
        f.add_incoming(better, b.block)
        n.add_incoming(more, b.block)
        b.cbranch(go_on, head, after)
        b.position_at_end(after)
        return better

    # cosines and what is computed side by side --------------------------------------------------------------------

    def _lower_rotation(self, es: list[Expression]) -> dict[str, Any]:
        """Cosine and sine of an angle, kept for both; beyond 45 degrees the C library's."""
        angle = es[0].args[0]
        out = self._rotation(self.value(angle), *(self.value(f(angle)) for f in (elementary.cosine, elementary.sine)))
        for op, value in out.items():
            self._known.here[intern(op, angle)] = value
        return out

    def _rotation(self, x: Any, *near: Any) -> dict[str, Any]:
        """LLVM values of cosine and sine of x: those ``near``, but the C library's beyond an eighth of a turn."""
        far = self.b.fcmp_ordered(">", call_intrinsic(self.b, "fabs", x), self._number(elementary.EIGHTH_TURN))
        before = self.b.block
        with self.b.if_then(self._any_lane(far), likely=False):
            beyond = [
                self.b.select(far, call_intrinsic(self.b, n, x), v) for n, v in zip(("cos", "sin"), near, strict=True)
            ]
            there = self.b.block
        out = {}
        for op, inner, outer in zip(("cosine", "sine"), near, beyond, strict=True):
            out[op] = self.b.phi(self._kind)
            out[op].add_incoming(inner, before)
            out[op].add_incoming(outer, there)
        return out

    def _compute_values(self, es: list[Expression], alike: bool) -> None:
        """Write code for ``es``, as one vector where they are ``alike``, and store their values for later use."""
        if not alike or not self._bundles or not 2 < len(es) <= BUNDLE or len({e.op for e in es}) > 1:
            for e in es:
                self.value(e)
            return
        self._memo: dict[tuple[Expression, ...], Any] = {}
        padded = tuple(es + [es[-1]] * (BUNDLE - len(es)))
        if es[0].op == "cosine":
            angles = tuple(e.args[0] for e in padded)
            x = self._row(angles)
            near = [self._row(tuple(f(a) for a in angles)) for f in (elementary.cosine, elementary.sine)]
            with self._vector_values():
                rows = self._rotation(x, *near)
            for op, row in rows.items():
                for k, e in enumerate(es):
                    self._known.here[intern(op, e.args[0])] = self.b.extract_element(row, ir.Constant(SHORT, k))
            return
        row = self._row(padded)
        for k, e in enumerate(es):
            self._known.here[e] = self.b.extract_element(row, ir.Constant(SHORT, k))

    def _row(self, es: tuple[Expression, ...]) -> Any:
        """LLVM vector of the values of expressions of equal form, from vectors of their arguments."""
        if es not in self._memo:
            self._memo[es] = self._row_of(es)
        return self._memo[es]

    def _row_of(self, es: tuple[Expression, ...]) -> Any:
        """LLVM vector of as many expressions, made of vectors of their arguments where they are alike."""
        first, kind = es[0], ir.VectorType(DOUBLE, BUNDLE)
        if all(e is first for e in es):
            if first.op == "constant":
                return ir.Constant(kind, [first.args[0]] * BUNDLE)
            return broadcast(self.b, self.value(first), BUNDLE)
        alike = all(e.op == first.op for e in es)
        if alike and first.op == "constant":
            return ir.Constant(kind, [e.args[0] for e in es])
        if not alike or first.op in ("read", "argument", "cosine", "sine", "newton", "bit"):
            out = ir.Constant(kind, ir.Undefined)
            for k, e in enumerate(es):
                out = self.b.insert_element(out, self.value(e), ir.Constant(SHORT, k))
            return out
        if first.op in ("named", "law"):
            return self._row(tuple(e.args[0] for e in es))
        if first.op in elementary.WRITTEN:
            return self._row(tuple(elementary.WRITTEN[e.op](*e.args) for e in es))
        if first.op == "guarded":
            truth, kept = self._row(tuple(e.args[0] for e in es)), dict(self._memo)
            with self._vector_values():
                out = self._lower_conditional(truth, lambda: self._narrow_row(tuple(e.args[1] for e in es)))
            self._memo = kept
            return out
        parts = [self._row(tuple(e.args[k] for e in es)) for k in range(len(first.args))]
        with self._vector_values():
            return self._lower_arithmetic(first.op, parts)

    def _narrow_row(self, es: tuple[Expression, ...]) -> Any:
        width, self._width = self._width, 1
        out = self._row(es)
        self._width = width
        return out

    @contextmanager
    def _vector_values(self) -> Iterator[None]:
        width, self._width = self._width, BUNDLE
        yield
        self._width = width

    # LLVM's own words ---------------------------------------------------------------------------------------------

    @property
    def _kind(self) -> Any:
        return DOUBLE if self._width == 1 else ir.VectorType(DOUBLE, self._width)

    def _number(self, x: float) -> Any:
        return ir.Constant(DOUBLE, x) if self._width == 1 else ir.Constant(self._kind, [x] * self._width)

    def _splat_of(self, kind: Any, x: int) -> Any:
        return ir.Constant(kind, x) if kind == INTEGER else ir.Constant(kind, [x] * kind.count)

    def _any_lane(self, truth: Any) -> Any:
        if truth.type == TRUTH:
            return truth
        bits = self.b.bitcast(truth, ir.IntType(truth.type.count))
        return self.b.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    def _integers(self, values: list[Any]) -> list[Any]:
        """LLVM integers of one type: per lane if any of them differs by lane, else scalar."""
        found = [x if isinstance(x, ir.Value) else ir.Constant(INTEGER, x) for x in values]
        if any(map(self._is_per_lane, found)):
            found = [x if self._is_per_lane(x) else broadcast(self.b, x, self.lanes) for x in found]
        return found

    def _is_per_lane(self, x: Any) -> bool:
        return isinstance(x, ir.Value) and isinstance(x.type, ir.VectorType)

    def _gather(self, array: str, place: int, behind: Any) -> Any:
        """LLVM value in which each lane reads element ``place`` at its offset ``behind``."""
        out = ir.Constant(self._lane_kind, ir.Undefined)
        for lane in range(self.lanes):
            row = self.b.add(ir.Constant(INTEGER, place), self.b.extract_element(behind, ir.Constant(SHORT, lane)))
            at = self.b.add(self.b.mul(row, ir.Constant(INTEGER, self.lanes)), ir.Constant(INTEGER, lane))
            number = self.b.load(self.b.gep(self._given[array], [at]), align=8)
            out = self.b.insert_element(out, number, ir.Constant(SHORT, lane))
        return out

    def _integer_value(self, e: Expression) -> Any:
        """LLVM integer of an expression that all lanes share, read in the first lane."""
        value = self.value(e)
        if value.type == INTEGER:
            return value
        if value.type != DOUBLE:
            value = self.b.extract_element(value, ir.Constant(SHORT, 0))
        return self.b.fptosi(value, INTEGER)

    def _pointer(self, place: Place) -> Any:
        """LLVM pointer to a place: a variable, or an element (a row of lanes) of an array argument."""
        array, k, further = place
        if array == "local":
            return self._name(str(k))
        index = ir.Constant(INTEGER, k)
        if further is not None:
            index = self.b.add(index, self.value(further))
        if self.lanes > 1:
            index = self.b.mul(index, ir.Constant(INTEGER, self.lanes))
        pointer = self.b.gep(self._given[array], [index])
        return pointer if self.lanes == 1 else self.b.bitcast(pointer, self._lane_kind.as_pointer())

    @property
    def _lane_kind(self) -> Any:
        return DOUBLE if self.lanes == 1 else ir.VectorType(DOUBLE, self.lanes)

    def _name(self, text: str) -> Any:
        if text not in self._names:
            with self.b.goto_block(self._function.entry_basic_block):
                self._names[text] = self.b.alloca(self._lane_kind, name=text)
                zero = 0.0 if self.lanes == 1 else [0.0] * self.lanes
                self.b.store(ir.Constant(self._lane_kind, zero), self._names[text])
        return self._names[text]
