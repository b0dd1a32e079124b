"""What a handler of a call is: a function from device, task and request to the fields of the response."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask

Fields = dict[str, Any]
"""Fields of a response, by name."""
TaskHandler = Callable[[DeviceState, SimulatedTask, Any], Fields | None]
"""Answers a call about a task from its request; None is an empty response."""
DeviceHandler = Callable[[DeviceState, Any], Fields | None]
"""Answers a call about the device from its request; None is an empty response."""
