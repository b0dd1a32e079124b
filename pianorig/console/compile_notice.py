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


class _Notice:
    """Speaks at the first compilation that is not part of another one."""

    def __init__(self) -> None:
        self._inside = threading.local()
        self._said = False

    def notify(self, event: Any) -> None:
        """Take an event of numba; its data name the compiled function."""
        depth = getattr(self._inside, "depth", 0)
        if event.is_start and not depth and not self._said:
            self._said = True
            cached = event.data["dispatcher"].stats.cache_path is not None
            say(ONCE if cached else EVERY_TIME)
        self._inside.depth = depth + (1 if event.is_start else -1)


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
    notice = _Notice()

    class Listener(events.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            notice.notify(event)

        def on_end(self, event: Any) -> None:
            notice.notify(event)

    return Listener()


def tell_when_compiling() -> None:
    """Say one line when the first kernel of this process is compiled; does nothing where numba is imported already."""
    if EVENTS not in sys.modules and not any(isinstance(finder, _OnImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OnImport())
