"""Generate, compile, cache and load the kernels of a scene's structure."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding, ir

from model.codegen.observable_programs import ObservablePrograms
from model.codegen.parameter_derivatives import ParameterDerivatives
from model.codegen.single_element import SingleElement
from model.codegen.step_programs import StepPrograms
from model.codegen.step_update import StepUpdate
from model.compiler.expressions import clear_cache
from model.compiler.native import KernelWriter
from model.compiler.programs import Program
from model.elements.laws.felt_law import Law
from model.elements.structure import Structure
from model.kernels import compile as _compile
from model.kernels.disk_cache import read_entry, write_entry
from model.kernels.kernel_value import Kernel
from model.kernels.lanes import has_wide_vectors
from model.kernels.layout import Tables
from model.kernels.process_lock import hold_lock
from model.kernels.signatures import ALONE, IN_LANES, STEP, StepKernels

Kind = tuple[np.ndarray, ...]
"""What tells kernels of one name apart, whole numbers: a scene's tables, a law along a press, nothing."""
# structures whose kernels this process has loaded, and how many of them it had to compile for that; values never do
COMPILED = {"scenes": 0, "compiled": 0}
_loaded: dict[tuple[bytes, str], Any] = {}
_asked: tuple[Kind | None, bytes] = None, b""
_lock = threading.RLock()  # threads that start together load or compile a structure once; expressions are one thread's


def _structure_key(tables: Kind) -> bytes:
    """Bytes that identify a structure; the last tables' are kept.

    A search for rest asks for the same ones hundreds of times, and each time it would take as long as the kernel.
    """
    global _asked
    last, key = _asked
    if last is not tables:
        key = b"".join(bytes(str(t.shape), "ascii") + t.tobytes() for t in tables)
        _asked = tables, key
    return key


def load_kernels(tables: Tables) -> StepKernels:
    """Kernels of the structure in ``tables``: from memory, from the disk cache, or compiled (about a second, once)."""
    found: StepKernels = _get_or_make(tables, "step", lambda: _step_kernels(tables, STEP, 1))
    return found


def load_lane_kernels(tables: Tables, lanes: int) -> StepKernels:
    """Kernels of a structure for ``lanes`` members side by side."""
    found: StepKernels = _get_or_make(tables, f"{lanes} lanes", lambda: _step_kernels(tables, IN_LANES, lanes))
    return found


def load_kernel(tables: Kind, what: str) -> Kernel:
    """One kernel of `ALONE`, compiled at its first use; ``tables`` is () where the kernel belongs to no scene."""
    found: Kernel = _get_or_make(tables, what, lambda: _compile_kernels(tables, {what: ALONE[what]}, 1)[what])
    return found


def memory_couplings(tables: Tables) -> list[list[int]]:
    """Indices of the coordinates that each internal variable acts on, then of those that the string acts on, in the
    order of the workspace."""

    def find_couplings() -> list[list[int]]:
        out = StepPrograms(Structure(tables)).links()
        clear_cache()
        return out

    links: list[list[int]] = _get_or_make(tables, "links", find_couplings)
    return links


def load_press_kernel(law: Law, memories: int, numbers: int, power: bool) -> Kernel:
    """Kernel ``press`` of `model.codegen.single_element`, for a law with these counts of memories and parameters."""
    return load_kernel((np.array([law.number, memories, numbers, int(power)]),), "press")


def is_cached(tables: Tables) -> bool:
    path = _path(tables, STEP, 1)
    return path is not None and path.is_file()


def _get_or_make(tables: Kind, what: str, make: Callable[[], Any]) -> Any:
    key = _structure_key(tables), what
    if key not in _loaded:
        with _lock:
            if key not in _loaded:
                _loaded[key] = make()
    return _loaded[key]


def _step_kernels(tables: Tables, functions: dict[str, Any], lanes: int) -> StepKernels:
    found = _compile_kernels(tables, functions, lanes)
    return StepKernels(**found, energy=found["linearise"])


def _path(tables: Kind, functions: dict[str, Any], lanes: int) -> Path | None:
    if _compile.FOLDER is None:
        return None
    digest = hashlib.sha256(_structure_key(tables) + f" {lanes} {' '.join(functions)}".encode())
    return _compile.FOLDER / f"scene_{digest.hexdigest()[:16]}.o"


def _compile_kernels(tables: Kind, functions: dict[str, Any], lanes: int) -> dict[str, Kernel]:
    """Kernels to be called, by the names in ``functions`` (name -> signature), each for ``lanes`` members: machine code
    read from the disk cache, or compiled and written to it. Scenes and compilations are counted in `COMPILED`."""
    path = _path(tables, functions, lanes)
    machine = _target_machine()
    code = read_entry(path) if path is not None else None
    made = code is None
    if code is None:
        with hold_lock(_compile.FOLDER, path.stem if path is not None else "scene"):
            if path is not None:
                code = read_entry(path)  # where another process was first
                made = code is None
            if code is None:
                code = bytes(machine.emit_object(link_kernels(tables, functions, lanes, machine)))
                if path is not None:
                    write_entry(path, code)
    if "stage" in functions:
        COMPILED["scenes"] += 1
        COMPILED["compiled"] += made
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return {name: Kernel(engine.get_function_address(name), of, engine) for name, of in functions.items()}


def write_kernel(program: Program, module: ir.Module, name: str, lanes: int = 1) -> None:
    """Add a program, as LLVM function ``name`` for ``lanes`` members side by side, to ``module``; it returns what the
    program's result says."""
    writer = KernelWriter(module, name, program.arguments, lanes, has_wide_vectors(), program.exact)
    writer.write(program.statements)
    result = program.result
    if isinstance(result, list):
        writer.end(writer.mask_of(result))
    elif result == "exceeded":
        writer.end(writer.bits(writer.exceeded))
    elif isinstance(result, str):
        writer.end(writer.count(result))
    else:
        writer.end(None if result is None else writer.bits(writer.value(result)))


def _module(tables: Kind, functions: dict[str, Any], lanes: int) -> ir.Module:
    module = ir.Module("scene")
    for name in functions:
        source = _program_source(tables, name, lanes)
        write_kernel(getattr(source, name)(), module, name, lanes)
        clear_cache()
    return module


def _program_source(kind: Kind, name: str, lanes: int) -> Any:
    """The object whose method ``name`` makes the program of that kernel: of a structure's tables ``kind``, or of a
    single element's whole numbers, one row."""
    if len(kind) < 2:
        return SingleElement(*(int(x) for row in kind for x in row))
    if hasattr(ObservablePrograms, name):
        return ObservablePrograms(Tables(*kind))
    s = Structure(Tables(*kind))
    return next((of(s) for of in (ParameterDerivatives, StepUpdate) if hasattr(of, name)), None) or StepPrograms(
        s, lanes > 1
    )


def _target_machine() -> Any:
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    name, features = _compile.target_processor()
    target = binding.Target.from_default_triple()
    return target.create_target_machine(cpu=name, features=features, opt=2, reloc="pic")


def link_kernels(tables: Kind, functions: dict[str, Any], lanes: int, machine: Any) -> Any:
    """One LLVM module with the optimised kernels that ``functions`` (name -> signature) names, each for ``lanes``
    members.

    Like operations of one run that lie side by side become one of vectors: a blow takes 0.94 of its time. Not in
    ``linearise``, where that gains nothing and takes a third of a second.
    """
    whole = binding.parse_assembly("")
    for name in functions:
        side_by_side = lanes == 1 and name in STEP and name != "linearise"
        whole.link_in(optimise_module(_module(tables, {name: functions[name]}, lanes), machine, side_by_side))
    return whole


def optimise_module(module: ir.Module, machine: Any, side_by_side: bool = False) -> Any:
    """The module parsed, verified and optimised by LLVM; ``side_by_side`` lets it vectorise straight code."""
    parsed = binding.parse_assembly(str(module))
    parsed.verify()
    options = binding.create_pipeline_tuning_options(speed_level=2)
    options.slp_vectorization = side_by_side
    passes = binding.create_pass_builder(machine, options)
    passes.getModulePassManager().run(parsed, passes)
    return parsed
