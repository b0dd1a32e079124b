"""Machine code of a few expressions or statements, called from a test."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
from llvmlite import binding, ir

from model.codegen.load import optimise_module, write_kernel
from model.compiler.expressions import Expression, clear_cache, read
from model.compiler.programs import Assign, Program, Statement, slot
from model.kernels.compile import target_processor

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_alive = []


def given(k: int) -> Expression:
    """Number ``k`` that the code is given."""
    return read("x", k)


def machine(statements: list[Statement] | list[Expression], lanes: int = 1) -> Callable[[np.ndarray], np.ndarray]:
    """A function of numbers (n,), or rows (n, lanes), that gives what is put to ``y``; expressions are put in order."""
    puts = [Assign(slot("y", k), s) if isinstance(s, Expression) else s for k, s in enumerate(statements)]
    module = ir.Module("test")
    write_kernel(Program({"x": "array", "y": "array"}, puts), module, "run", lanes)
    clear_cache()
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    processor, features = target_processor()
    emitter = binding.Target.from_default_triple().create_target_machine(processor, features, opt=2, reloc="pic")
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), emitter)
    engine.add_object_file(binding.ObjectFileRef.from_data(emitter.emit_object(optimise_module(module, emitter))))
    engine.finalize_object()
    _alive.append(engine)
    call = ctypes.CFUNCTYPE(ctypes.c_int64, _DOUBLES, _DOUBLES)(engine.get_function_address("run"))

    def run(x: np.ndarray) -> np.ndarray:
        x = np.ascontiguousarray(x, dtype=float)
        y = np.zeros((40, lanes) if lanes > 1 else 40)
        call(x.ctypes.data_as(_DOUBLES), y.ctypes.data_as(_DOUBLES))
        return y

    return run
