"""Sessions on a NI gRPC Device Server: the server keeps them when a client dies, and refuses their names to the next.

A recording marks its sessions by one more, named after rig and computer, and holds a lock file on this computer while
it lives. Who gets the lock and finds the mark knows that the program that made it is dead, that it was this rig's and
this computer's, and clears what it left. Other sessions are never touched; :func:`reset_server` ends all of them.
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
import nidaqmx
from nidaqmx.grpc_session_options import SessionInitializationBehavior

from rig.configuration.rig_file import RigConfig
from rig.daq import safe_bench, tasks
from rig.daq.faults import translated
from rig.daq.safe_bench import WATCHDOG
from rig.errors import ResourceBusy
from rig.storage.platform_calls import lock, open_raw

RESET = "/nidevice_grpc.SessionUtilities/ResetServer"
RESET_TIMEOUT_S = 10.0
_TAKEN = grpc.StatusCode.ALREADY_EXISTS
SESSIONS = (WATCHDOG, tasks.MOTOR, tasks.MASTER, safe_bench.ZERO, safe_bench.DRIVE, tasks.CAMERA, tasks.EDGES)
"""Sessions that a recording opens, beside those of its encoders."""


class ServerClaim:
    """The claim of one recording on the sessions of its rig at a server."""

    def __init__(self, channel: grpc.Channel, target: str) -> None:
        self._channel, self._target = channel, target
        self._mark: nidaqmx.Task | None = None
        self._lock: int | None = None

    def take(self, config: RigConfig) -> bool:
        """Claim the sessions; return whether those of a program that died were cleared for it.

        Raises
        ------
        ResourceBusy
            When another program on this computer records with this device.
        HardwareFault
            When the server does not answer.
        """
        if self._mark is not None:
            return False
        self._take_lock(config)

        def session(name: str, behavior: SessionInitializationBehavior) -> nidaqmx.Task:
            return nidaqmx.Task(name, grpc_options=tasks.session_options(self._channel, name, behavior))

        mark = re.sub(r"\W", "_", f"pianorig_{config.name}_on_{platform.node()}")
        with translated("connect", f"server {self._target}"):
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
        """Give up mark and lock."""
        mark, self._mark = self._mark, None
        with contextlib.suppress(nidaqmx.errors.Error, grpc.RpcError):  # a server that is gone keeps nothing
            if mark is not None:
                mark.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _take_lock(self, config: RigConfig) -> None:
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


def reset_server(channel: grpc.Channel, target: str) -> None:
    """End all sessions of a server, of whomever; outputs keep their values.

    Raises HardwareFault when the server does not answer or refuses.
    """
    call = channel.unary_unary(RESET, request_serializer=lambda request: request, response_deserializer=lambda raw: raw)
    with translated("connect", f"server {target}"):
        try:
            call(b"", timeout=RESET_TIMEOUT_S)
        except grpc.RpcError as error:
            code = error.code() if isinstance(error, grpc.Call) else grpc.StatusCode.UNAVAILABLE
            raise nidaqmx.errors.RpcError(code, str(error)) from error
