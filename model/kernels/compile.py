"""The decorator of every compiled kernel: numba with a disk cache that cannot return stale code.

Numba's own cache watches one file only: a caller in another file keeps using an old callee and silently returns wrong
numbers. The cache folder is therefore keyed by a SHA-256 over all sources that kernels are made of, the versions of
Python, numba and numpy, and the processor. Where no user cache can be written, kernels are compiled in memory only.
"""

from __future__ import annotations

import gc
import hashlib
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import binding
from numba.core import codegen
from numba.core import config as _config
from numba.np import linalg

from model.kernels.disk_cache import verify_cache
from model.kernels.machine_code import make_machine_code_when_called
from model.kernels.process_lock import hold_lock


def defer_blas_import() -> None:
    """Keep numba from importing SciPy's linear algebra, a sixth of a start, before something is compiled that needs it.

    Numba asks at import whether there is BLAS, and again wherever it is used; there is, since the model needs SciPy.
    """
    ask: Any = getattr(linalg, "ensure_blas", None)
    if "numba.np.arraymath" not in sys.modules and callable(ask):
        linalg.ensure_blas = lambda: None
        try:
            arraymath: Any = import_module("numba.np.arraymath")
            arraymath.ensure_blas = ask
        finally:
            linalg.ensure_blas = ask


numba_config: Any = _config  # set at run time by numba; its names are unknown to type checkers
_PACKAGE = Path(__file__).resolve().parents[1]
make_machine_code_when_called()
defer_blas_import()
COMMON: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": False}
NO_WRAPPERS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def kernel_sources() -> list[Path]:
    """Files whose text decides what the kernels compute."""
    folders = ("kernels", "integrators", "compiler", "elements", "codegen")
    return sorted(path for folder in folders for path in _PACKAGE.glob(f"{folder}/**/*.py"))


def target_processor() -> tuple[str, str]:
    """Name and features of the processor that numba compiles for: this one, unless ``NUMBA_CPU_*`` name another."""
    name, features = numba_config.CPU_NAME, numba_config.CPU_FEATURES
    return (
        binding.get_host_cpu_name() if name is None else name,
        codegen.get_host_cpu_features() if features is None else features,
    )


def cache_key() -> str:
    """Digest of all kernel sources, versions and the processor compiled for, as 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for part in (
        sys.version,
        numba.__version__,
        np.__version__,
        platform.machine(),
        *target_processor(),
    ):
        digest.update(part.encode())
    for path in kernel_sources():
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Folder that holds one cache folder per key; ``PIANORIG_CACHE_DIR`` moves it."""
    named = os.environ.get("PIANORIG_CACHE_DIR")
    if named:
        return Path(named)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return base / "piano-action-rig" / "kernels"


def _writable_cache() -> Path | None:
    """Folder of this key's cache, made if need be; None where it cannot be written to."""
    try:
        folder = cache_root() / cache_key()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, RuntimeError):  # RuntimeError: there is no home folder
        return None
    return folder


FOLDER = _writable_cache()


def _compile_inner(function: Callable[..., Any], options: dict[str, Any], keep: bool = False) -> Any:
    """Compile a ``function`` that compiled code calls, without the wrappers for Python (a sixth less to compile); a
    call from Python compiles a twin. ``keep``: cache it on disk."""
    compile_with: Any = numba.njit  # its types do not name all options
    made = compile_with(**options | NO_WRAPPERS)(function)
    if keep:
        verify_cache(made)
    made._insert = lambda *_: None  # numba's dispatcher is to find nothing that it may call, and to ask
    twin = cache(lambda: compile_with(**options)(function))
    made._compile_for_args = lambda *given, **named: twin()._compile_for_args(*given, **named)
    return made


def _compile_cached(*signature: Any, inner: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compile with numba, without the GIL, at once where a ``signature`` is given, and cache the machine
    code in ``FOLDER``; ``inner``: for calls from compiled code."""

    def decorate(function: Callable[..., Any]) -> Any:
        before = numba_config.CACHE_DIR
        numba_config.CACHE_DIR = "" if FOLDER is None else str(FOLDER)
        try:
            common = COMMON | {"no_cfunc_wrapper": True}
            if inner:
                return _compile_inner(function, common | options, FOLDER is not None)
            njit: Any = numba.njit  # its types do not name all options
            made = njit(**common | options)(function)
            if FOLDER is not None:
                verify_cache(made)
            if signature:
                made.compile(*signature)
                made.disable_compile()
            return made
        finally:
            numba_config.CACHE_DIR = before

    return decorate


kernel = _compile_cached()
"""Compile a function on first use, without the GIL, cached under the key of all kernel sources."""
uncounted = _compile_cached(_nrt=False, inner=True)
"""Like `kernel`, for a function that allocates nothing: without numba's run time it counts no references.

Counting those of the arrays in a named tuple took a tenth of a step."""
inlined = partial(_compile_inner, options=COMMON | {"forceinline": True})
"""Compile a small function into each of its callers; not cached on its own, it lives in theirs."""
inlined_uncounted = partial(_compile_inner, options=COMMON | {"forceinline": True, "_nrt": False})
"""Like `inlined`, for what allocates nothing and takes many arrays: it counts no references to them."""


@contextmanager
def _collect_no_garbage() -> Iterator[None]:
    """Leave what compiling leaves behind where it lies: looking through it takes a seventh of the time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def step_loop(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of a step loop: explicit types, in which a scene's kernels are values, so that one loop serves all.

    Without them numba compiles the loop again for every scene, and never finds it on disk.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        with hold_lock(FOLDER, f"{function.__module__}.{function.__qualname__}"), _collect_no_garbage():
            return _compile_cached(signature, **options)(function)

    return decorate


def uncounted_loop(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Like `step_loop`, for a function that allocates nothing and counts no references."""
    return step_loop(signature, _nrt=False)
