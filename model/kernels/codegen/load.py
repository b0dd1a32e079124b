"""Find, write, compile and load the kernels of a scene's structure.

``kernels_of(tables)`` gives them; the source lies in the kernel cache under a name that is the hash of its text,
so that a structure is compiled once per machine and a changed parameter value never. Where no cache can be
written the source is compiled in memory.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
import threading
from pathlib import Path
from types import ModuleType
from typing import Any

from model.kernels import compile as _compile
from model.kernels.codegen.energy import emit_energy
from model.kernels.codegen.step_kernels import emit_with_pieces
from model.kernels.kernel_value import Kernel
from model.kernels.layout import Tables
from model.kernels.once import alone
from model.kernels.signatures import (
    ENERGY,
    LANE_LINEARISE,
    LANE_PREPARE,
    LANE_SKIP,
    LANE_STAGE,
    LINEARISE,
    PREPARE,
    SKIP,
    STAGE,
    LaneKernels,
    StepKernels,
)

_loaded: dict[bytes, StepKernels] = {}
_in_lanes: dict[tuple[bytes, int], LaneKernels] = {}
_energies: dict[bytes, Any] = {}
_asked: tuple[Tables | None, bytes] = None, b""
# structures whose kernels this process has loaded, and how many of them it had to compile for that; values never do
COMPILED = {"scenes": 0, "compiled": 0}
_lock = threading.RLock()  # threads that start together load or compile a structure once


def _write(path: Path, text: str) -> None:
    """Write whole or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(name, path)


def _name(text: str) -> str:
    return "scene_" + hashlib.sha256(text.encode()).hexdigest()[:16]


def _load(text: str, name: str = "") -> ModuleType:
    """Module with this text: written to the cache under its name, by default the hash of its text, and imported."""
    name = name or _name(text)
    if _compile.FOLDER is None:
        module = sys.modules[name] = ModuleType(name)
        exec(compile(text, f"<{name}>", "exec"), module.__dict__)
        return module
    path = _compile.FOLDER / f"{name}.py"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        _write(path, text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # numba looks a cached function's module up by name
    spec.loader.exec_module(module)
    return module


def _key(tables: Tables) -> bytes:
    """What tells a structure from others; of the tables asked for last it is kept.

    A search for rest asks for the same ones hundreds of times, and each time it would take as long as the kernel.
    """
    global _asked
    last, key = _asked
    if last is not tables:
        key = b"".join(bytes(str(t.shape), "ascii") + t.tobytes() for t in tables)
        _asked = tables, key
    return key


def energy_of(tables: Tables) -> Any:
    """Kernel of the energy audit of a structure; compiled only when a run asks for it."""
    key = _key(tables)
    if key not in _energies:
        with _lock:
            if key not in _energies:
                _energies[key] = Kernel(_load(emit_energy(tables)).energy, ENERGY)
    return _energies[key]


def _load_with_pieces(tables: Tables, lanes: int = 1) -> ModuleType:
    text, pieces = emit_with_pieces(tables, lanes)
    with alone(_compile.FOLDER, _name(text)):
        for piece in pieces:
            if piece.name not in sys.modules:
                _load(piece.text, piece.name)
        return _load(text)


def on_disk(tables: Tables) -> bool:
    """Whether the kernels of a structure are in the disk cache, or are being made there."""
    text, _ = emit_with_pieces(tables)
    return _compile.FOLDER is not None and (_compile.FOLDER / f"{_name(text)}.py").is_file()


def lane_kernels_of(tables: Tables, lanes: int) -> LaneKernels:
    """Kernels of a structure for ``lanes`` members side by side; no coordinate may be prescribed."""
    key = _key(tables), lanes
    if key not in _in_lanes:
        with _lock:
            if key not in _in_lanes:
                module = _load_with_pieces(tables, lanes)
                kernels = LaneKernels(
                    Kernel(module.linearise, LANE_LINEARISE),
                    Kernel(module.prepare, LANE_PREPARE),
                    Kernel(module.skip, LANE_SKIP),
                    Kernel(module.stage, LANE_STAGE),
                )
                COMPILED["scenes"] += 1
                COMPILED["compiled"] += not all(k.stats.cache_hits for k in kernels)
                _in_lanes[key] = kernels
    return _in_lanes[key]


def kernels_of(tables: Tables) -> StepKernels:
    """Kernels of the structure in ``tables``: from memory, from the disk cache, or compiled (a few seconds, once)."""
    key = _key(tables)
    if key not in _loaded:
        with _lock:
            if key not in _loaded:
                module = _load_with_pieces(tables)
                linearise = Kernel(module.linearise, LINEARISE)
                kernels = StepKernels(
                    linearise,
                    Kernel(module.prepare, PREPARE),
                    Kernel(module.skip, SKIP),
                    Kernel(module.stage, STAGE),
                    energy=linearise,
                )
                COMPILED["scenes"] += 1
                COMPILED["compiled"] += not all(k.stats.cache_hits for k in kernels)
                _loaded[key] = kernels
    return _loaded[key]
