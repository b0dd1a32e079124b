"""Compile kernels in a second process while this one compiles others."""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread

from llvmlite.binding import ffi

from model.codegen.load import is_cached, load_kernels, load_lane_kernels
from model.kernels import compile as _compile
from model.kernels.lanes import LANES, has_wide_vectors
from model.parameters.action import load_action
from model.scene.build import build_scene
from model.scene.selection import SceneChoice

_ROOT = str(Path(__file__).resolve().parents[2])
_BESIDE = f"import sys; sys.path.insert(0, {_ROOT!r}); from model.simulation.compile_ahead import main; main()"


def compile_ahead(
    choices: Sequence[SceneChoice], *, loop: bool = False, lanes: bool = False, then: str = ""
) -> subprocess.Popen[bytes] | None:
    """Start a process that compiles scenes and, if asked, step ``loop`` and ``lanes``, into the cache, then calls
    ``then`` ('module:function'); None where they are cached, none is kept, or there is one processor.

    Halves the wait of a first run: call it before what integrates is first used.

    Parameters
    ----------
    choices : scenes that will be needed, the first needed first
    loop : the step loop before them; for a caller that begins with a scene that is not among them
    lanes : before all, what advances members side by side, which takes as long as the step loop (`compile_lanes`)
    then : ``module:function`` to call afterwards, for kernels that are compiled where they are first called

    Returns
    -------
    subprocess.Popen or None
        The process; it ends by itself. None where the step loop or all scenes are in the cache, where nothing can be
        kept, or on a single processor.

    Examples
    --------
    >>> import model
    >>> beside = model.compile_ahead([model.SceneChoice()])
    >>> solution = model.simulate(model.load_action(), *model.force_table("forte"))
    >>> model.compile_ahead([model.SceneChoice()]) is None  # now all is there
    True
    """
    folder = _compile.FOLDER
    if folder is None or (os.cpu_count() or 1) < 2 or any(folder.rglob("rosenbrock.integrate-*.nbi")):
        return None
    action = load_action()
    cold = [choice for choice in choices if not is_cached(build_scene(choice.apply_to(action), choice).tables)]
    if not cold:
        return None
    try:
        beside = subprocess.Popen(
            [sys.executable, "-c", _BESIDE],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PIANORIG_CACHE_DIR": str(_compile.cache_root())},
        )
        assert beside.stdin is not None
        beside.stdin.write(pickle.dumps((cold, loop, lanes, then)))
        beside.stdin.close()
    except OSError:
        return None
    Thread(target=beside.wait, daemon=True).start()  # takes note of its end, while the caller goes on
    return beside


def compile_lanes(choice: SceneChoice) -> None:
    """Compile here, for members side by side, a scene and the loop that advances them, where lanes pay.

    For a caller that will need them, while what it needs before is compiled beside it.

    Parameters
    ----------
    choice : the scene

    Examples
    --------
    >>> import model
    >>> model.compile_lanes(model.SceneChoice())
    """
    if has_wide_vectors():
        from model.integrators.lanes import compile_lane_loop  # start-up: 0.1 s, few need lanes

        load_lane_kernels(build_scene(choice.apply_to(load_action()), choice).tables, LANES)
        compile_lane_loop(LANES)


def main() -> None:
    """Compile the scenes that the standard input holds (pickled), then call the function that it names."""
    for told in list(getattr(getattr(ffi.lib, "_lock", None), "_cblist", ())):
        ffi.unregister_lock_callback(*told)  # numba's own, which time each call of LLVM, as often as functions nest
    gc.disable()  # what compiling leaves behind is looked through for a seventh of its time; the process ends soon
    choices, loop, lanes, then = pickle.load(sys.stdin.buffer)
    for choice in choices if lanes else ():
        compile_lanes(choice)
    if loop:
        import model.integrators.rosenbrock  # noqa: F401  # start-up: seconds, its import compiles the loop
    action = load_action()
    for choice in choices:
        load_kernels(build_scene(choice.apply_to(action), choice).tables)
    if then:
        module, _, function = then.partition(":")
        getattr(importlib.import_module(module), function)()
