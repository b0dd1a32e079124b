"""The backend of a recording: opened from an address and closed at the end, or one that somebody else has opened."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rig.backend import Backend, check_contract, open_backend
from rig.configuration.rig_file import RigConfig
from rig.errors import HardwareFault
from rig.safety.interrupts import deferred


@contextlib.contextmanager
def recording_backend(given: Backend | str, config: RigConfig) -> Iterator[Backend]:
    """Open ``given`` where it is an address, check what it offers, and close what was opened here."""
    own = isinstance(given, str)
    backend = open_backend(given, config) if isinstance(given, str) else given
    check_contract(backend)
    try:
        yield backend
    except BaseException:
        if own:
            with deferred(), contextlib.suppress(HardwareFault):
                backend.close()  # the first fault is the one to report
        raise
    else:
        if own:
            backend.close()
