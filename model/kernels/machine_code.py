"""Faster compilation: machine code is generated only of what Python calls.

Of the functions behind a step loop nine in ten are never called from Python, and a compiled caller takes their
intermediate code into its own. Where numba has another inside than the one known here nothing is changed.
docs/explanation/one_text.md.
"""

from __future__ import annotations

from typing import Any

from numba.core import codegen, targetconfig

_NAMES = ("_finalize_final_module", "_finalize_dynamic_globals", "get_pointer_to_function", "serialize_using_bitcode")


def make_machine_code_when_called() -> bool:
    """Have numba make machine code late in this process; False where it cannot."""
    owner: Any = getattr(codegen, "JITCPUCodegen", None)
    plain: Any = getattr(owner, "_library_class", None)
    if plain is None or not all(hasattr(plain, name) for name in _NAMES) or not hasattr(owner, "set_env"):
        return False
    if getattr(plain, "waits", False):
        return True
    # environments of functions, by name, for which there was no machine code yet
    waiting: dict[str, Any] = {}
    set_now = owner.set_env

    class Library(plain):  # type: ignore[misc]
        """Code of a function; its machine code is made when its address, or the object for the disk, is asked for."""

        waits = True
        _made = False

        def _finalize_final_module(self) -> None:
            if self._object_caching_enabled and self._compiled_object:  # from the disk, to be called
                self._make()
                return
            self._finalize_dynamic_globals()
            self._finalized = True

        def _optimize_final_module(self) -> None:
            flags = targetconfig.ConfigStack.top_or_none()
            inner = flags is not None and flags.no_cpython_wrapper and flags.no_cfunc_wrapper
            # a caller's passes see it again; without fast arithmetic no pass changes a bit. What is inlined by force is
            # small, and lanes ran 2 % slower without
            if not inner or flags.fastmath or flags.forceinline:
                super()._optimize_final_module()

        def _make(self) -> None:
            if self._made:
                return
            self._made = True
            super()._finalize_final_module()
            for name in [gv.name for gv in self._final_module.global_variables if gv.name in waiting]:
                set_now(self._codegen, name, waiting[name])

        def get_pointer_to_function(self, name: str) -> int:
            self._ensure_finalized()
            if not self._made:
                try:
                    missing = self.get_function(name).is_declaration
                except NameError:
                    missing = True
                if missing:
                    return 0
                self._make()
            return int(super().get_pointer_to_function(name))

        def serialize_using_object_code(self) -> Any:
            """What is kept on disk: machine code only of what has been called by its address."""
            self._ensure_finalized()
            return super().serialize_using_object_code() if self._made else self.serialize_using_bitcode()

    def set_env(self: Any, name: str, env: Any) -> None:
        waiting[name] = env
        if self._engine.get_global_value_address(name):
            set_now(self, name, env)

    owner._library_class = Library
    owner.set_env = set_env
    return True
