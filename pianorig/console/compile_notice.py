"""One line when kernels are compiled, so that half a minute of silence is explained, once.

Numba tells its listeners when a compilation begins; a kernel found on disk begins none. The listener is added when
numba is imported, whoever does it, so that a command that compiles nothing does not pay for numba
(docs/explanation/one_text.md).
"""

from __future__ import annotations

import importlib.util
import sys
import threading
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from pianorig.console.progress import say

EVENTS = "numba.core.event"
ONCE = "compiling kernels (once, up to half a minute) ..."
EVERY_TIME = (
    "compiling kernels (half a minute, at every call: their cache cannot be written; set PIANORIG_CACHE_DIR to a "
    "folder that can) ..."
)


class _OnImport(MetaPathFinder):
    """Registers the notice as soon as numba's events are imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Let the other finders find the module, then add to what happens when it is executed."""
        if fullname != EVENTS:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            module.register("numba:compile", _listener(module))

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _listener(events: Any) -> Any:
    """Speaks at the first compilation that is not part of another one; an event's data name the compiled function."""
    inside, said = threading.local(), threading.Event()

    class Listener(events.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            depth = getattr(inside, "depth", 0)
            if not depth and not said.is_set():
                said.set()
                say(EVERY_TIME if event.data["dispatcher"].stats.cache_path is None else ONCE)
            inside.depth = depth + 1

        def on_end(self, event: Any) -> None:
            inside.depth = getattr(inside, "depth", 0) - 1

    return Listener()


def tell_when_compiling() -> None:
    """Say one line when the first kernel of this process is compiled; does nothing where numba is imported already."""
    if EVENTS not in sys.modules and not any(isinstance(finder, _OnImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OnImport())
