"""The claim of a recording on its rig's sessions at a server, which keeps those of a client that dies.

It refuses their names to the next client. So a recording marks its sessions by one more, named after rig and computer,
and holds a lock file on this computer while it lives. Who gets the lock and finds the mark knows that the program that
made it is dead, that it was this rig's and this computer's, and clears what it left. Other sessions are never touched.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import tempfile
from pathlib import Path

import grpc
import nidaqmx.errors
from nidaqmx.grpc_session_options import SessionInitializationBehavior

from rig.configuration.rig_file import RigConfig
from rig.daq import safe_bench, tasks
from rig.daq.faults import translate_faults
from rig.daq.safe_bench import WATCHDOG
from rig.errors import ResourceBusy
from rig.platform_calls import lock, open_raw

_TAKEN = grpc.StatusCode.ALREADY_EXISTS
_CHECKED = (tasks.MASTER, tasks.EDGES, tasks.CAMERA, tasks.MOTOR, tasks.VOLTAGE)
SESSIONS = (
    *(WATCHDOG, tasks.MOTOR, tasks.MASTER, safe_bench.ZERO, safe_bench.DRIVE, tasks.CAMERA, tasks.EDGES),
    *(tasks.OPPOSITE, *map(tasks.CHECK.format, _CHECKED)),
)
"""Sessions that a recording or a self-test opens, beside those of the encoders."""


class ServerClaim:
    """The claim of one recording on the sessions of its rig at a server."""

    def __init__(self, channel: grpc.Channel, target: str) -> None:
        self._channel, self._target = channel, target
        self._mark: nidaqmx.Task | None = None
        self._lock: int | None = None

    def take(self, config: RigConfig) -> bool:
        """Claim the rig's sessions at the server, once; return whether sessions that a program of this computer left
        when it died were cleared for it. `ResourceBusy` where one that lives holds the device."""
        if self._mark is not None:
            return False
        self._take_lock(config)

        def session(name: str, behavior: SessionInitializationBehavior) -> nidaqmx.Task:
            return nidaqmx.Task(name, grpc_options=tasks.session_options(self._channel, name, behavior))

        mark = re.sub(r"\W", "_", f"pianorig_{config.name}_on_{platform.node()}")
        with translate_faults("connect", f"server {self._target}"):
            try:
                self._mark = session(mark, tasks.NEW)
                return False
            except nidaqmx.errors.RpcError as error:
                if error.rpc_code not in (_TAKEN, _TAKEN.value[0]):
                    raise
            self._mark = session(mark, tasks.ATTACHED)
            for name in (*SESSIONS, *map(tasks.encoder_task_name, config.encoders)):
                with contextlib.suppress(nidaqmx.errors.Error):  # it did not get as far as opening this one
                    session(name, tasks.ATTACHED).close()
        return True

    def release(self) -> None:
        """Close the mark at the server and unlock the device on this computer."""
        mark, self._mark = self._mark, None
        with contextlib.suppress(nidaqmx.errors.Error, grpc.RpcError):  # a server that is gone keeps nothing
            if mark is not None:
                mark.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _take_lock(self, config: RigConfig) -> None:
        """Lock the device on this computer; `ResourceBusy` where another program holds it."""
        key = hashlib.sha256(f"{self._target} {config.device.name}".encode()).hexdigest()[:16]
        path = Path(tempfile.gettempdir()) / f"pianorig-{key}.lock"
        descriptor = open_raw(path, os.O_RDWR | os.O_CREAT)
        if not lock(descriptor):
            os.close(descriptor)
            raise ResourceBusy(
                f"device {config.device.name} at {self._target}: another program on this computer records with it; "
                "end that first",
                phase="connect",
            )
        self._lock = descriptor
