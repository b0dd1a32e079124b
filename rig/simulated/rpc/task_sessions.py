"""Sessions of NI's gRPC server: whether a client gets a new task or attaches to one that exists."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.rpc.handlers import Fields
from rig.simulated.status import SessionRefused

INITIALIZE_NEW, ATTACH_TO_EXISTING = 1, 2
"""Initialization behaviors; 0 attaches where a session exists."""


def open_session(device: DeviceState, request: Any, create: Callable[[], SimulatedTask]) -> Fields:
    """Return the task that a client attaches to, or a new one, as NI's server decides; may refuse."""
    name, behavior = request.session_name, request.initialization_behavior
    if behavior == INITIALIZE_NEW and name in device.tasks:
        raise SessionRefused("ALREADY_EXISTS", f"Cannot initialize '{name}' when a session already exists.")
    if behavior == ATTACH_TO_EXISTING and name not in device.tasks:
        detail = f"Cannot attach to '{name}' because a session has not been initialized."
        raise SessionRefused("FAILED_PRECONDITION", detail)
    found = device.tasks.get(name)
    return {"task": {"name": (found or create()).name}, "new_session_initialized": found is None}
