"""Machine code of a few expressions or statements, called from a test."""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import binding, ir

from model.compiler.expressions import Expression, forget, parts, read
from model.compiler.programs import Add, Program, Put, Statement, at
from model.derived.load import STEP, _module, _source, _target_machine, optimised, written
from model.kernels.layout import Tables

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_alive = []


def given(k: int) -> Expression:
    """Number ``k`` that the code is given."""
    return read("x", k)


def machine(statements: list[Statement] | list[Expression], lanes: int = 1) -> Callable[[np.ndarray], np.ndarray]:
    """A function of numbers (n,), or rows (n, lanes), that gives what is put to ``y``; expressions are put in order."""
    puts = [Put(at("y", k), s) if isinstance(s, Expression) else s for k, s in enumerate(statements)]
    module = ir.Module("test")
    written(Program({"x": "array", "y": "array"}, puts), module, "run", lanes)
    forget()
    target = _target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(target.emit_object(optimised(module, target))))
    engine.finalize_object()
    _alive.append(engine)
    call = ctypes.CFUNCTYPE(ctypes.c_int64, _DOUBLES, _DOUBLES)(engine.get_function_address("run"))

    def run(x: np.ndarray) -> np.ndarray:
        x = np.ascontiguousarray(x, dtype=float)
        y = np.zeros((40, lanes) if lanes > 1 else 40)
        call(x.ctypes.data_as(_DOUBLES), y.ctypes.data_as(_DOUBLES))
        return y

    return run


def touched(tables: Tables, *kernels: str) -> set[int]:
    """Places of the workspace that a structure's kernels read or write outright."""
    out: set[int] = set()
    for kernel in kernels or STEP:
        todo: list[Any] = list(getattr(_source(tables, kernel, 1), kernel)().statements)
        values: list[Expression] = []
        while todo:
            s = todo.pop()
            if isinstance(s, Expression):
                values.append(s)
            elif isinstance(s, Put | Add):
                out |= {int(s.place[1])} if s.place[0] == "w" else set()
                values.append(s.value)
            elif isinstance(s, list | tuple):
                todo += s
            elif isinstance(s, Statement):
                todo += vars(s).values()
        out |= {e.args[1] for e in parts(values) if e.op == "read" and e.args[0] == "w"}
    forget()
    return out


def operations(tables: Tables, *kernels: str) -> Counter[str]:
    """How often each arithmetic operation stands in it."""
    text = str(_module(tables, dict.fromkeys(kernels or STEP), 1))
    return Counter(line.split(" = ")[1].split()[0] for line in text.splitlines() if " = f" in line)
