"""Which bench a workflow uses, and how its operator permits the motor to move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pianorig.console.options import SELFTESTS
from rig import Backend, Permission, Rig, permit


@dataclass(frozen=True)
class BenchAccess:
    """A bench and the permission to move it.

    Attributes
    ----------
    rig : built-in rig or path of a rig file
    backend : address, ``sim://``, ``ni://local`` or ``ni-grpc://host:port``
    yes : take the place of a typed confirmation, where the rig file permits
    ask : shows a question and returns what was typed; None when nobody can be asked
    selftests : record of a self-test, or the folder of them
    """

    rig: str | Path = "virtual"
    backend: str = "sim://"
    yes: bool = False
    ask: Callable[[str], str | None] | None = None
    selftests: Path = SELFTESTS

    def permission(self, rig_file: Rig, bench: Backend) -> Permission | None:
        """Permission to move the hardware behind ``bench``; None where nothing real moves.

        Raises
        ------
        rig.errors.NotPermitted : hardware without self-test or confirmation; nothing has moved
        """
        if not bench.capabilities.hardware:
            return None
        return permit(rig_file, self.backend, self.selftests, yes=self.yes, ask=self.ask)
