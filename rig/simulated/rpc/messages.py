"""The protobuf messages of NI's DAQmx service, found by the name of the call.

No other module touches the generated classes: they are private parts of ``nidaqmx`` (pinned >= 1.7, < 2). A test checks
that every call the virtual device answers exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import grpc
from google.protobuf.message_factory import GetMessageClass
from nidaqmx._stubs import nidaqmx_pb2

from rig.simulated import daqmx
from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.status import (
    Code,
    DaqStatusError,
    NotAnswered,
    ServerGone,
    SessionRefused,
    Unsupported,
    require_one_of,
)

_METHODS = nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"].methods_by_name
CALLS: frozenset[str] = frozenset(_METHODS)
"""Names of all calls of the service."""


def request_class(call: str) -> Any:
    return GetMessageClass(_METHODS[call].input_type)


def response(call: str, **fields: Any) -> Any:
    return GetMessageClass(_METHODS[call].output_type)(**fields)


_KINDS: dict[str, type | tuple[type, ...]] = {
    "String": str, "Bool": bool, "Int32": int, "UInt32": int, "UInt64": int, "Double": float, "Array": list,
}  # fmt: skip


def attribute_fields(call: str, value: Any) -> dict[str, Any]:
    """Return the response's fields of a Get…Attribute call; refuses a property of another type than the call's."""
    kind = next(kind for kind in ("Array", "UInt32", "UInt64", *_KINDS) if call.endswith(kind))
    if not isinstance(value, _KINDS[kind]) or (kind != "Bool" and isinstance(value, bool)):
        raise Unsupported(f"{call}: the property is of another type")
    has_raw = "value_raw" in _METHODS[call].output_type.fields_by_name
    return {"value": value, "value_raw": value} if has_raw else {"value": value}


def property_number(category: str, name: str) -> int:
    return int(getattr(nidaqmx_pb2, f"{_prefix(category)}{name}"))


def property_name(category: str, number: int) -> str:
    """Return the name of a property by the driver's number; the number where the service has no name for it."""
    prefix = _prefix(category)
    named = (name for name in dir(nidaqmx_pb2) if name.startswith(prefix) and getattr(nidaqmx_pb2, name) == number)
    return next(named, f"{prefix}0x{number:04X}").removeprefix(prefix)


def _prefix(category: str) -> str:
    other = {"Chan": "CHANNEL", "Trig": "TRIGGER", "SystemInfo": "SYSTEM", "ExportedSignal": "EXPORTSIGNAL"}
    return f"{other.get(category, category.upper())}_ATTRIBUTE_"


def refuse_not_finite(request: Any) -> None:
    for field, value in request.ListFields():
        if field.cpp_type == field.CPPTYPE_DOUBLE:
            numbers = [value] if isinstance(value, float) else value
            if not all(map(math.isfinite, numbers)):
                raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{field.name}: {value}")


def enum(request: Any, field: str) -> int:
    return int(getattr(request, field + "_raw") or getattr(request, field))


def refuse_falling_edge(request: Any, field: str) -> None:
    """Refuse an edge that is none, and a falling one, by which nothing on the virtual bench is clocked or counted."""
    edge = enum(request, field)
    require_one_of(edge, (daqmx.RISING, daqmx.FALLING), "Edge")
    if edge == daqmx.FALLING:
        raise NotAnswered(f"falling edge as {field}")


def attribute_value(request: Any) -> Any:
    names = {field.name for field in request.DESCRIPTOR.fields}
    if "value_raw" in names and request.WhichOneof("value_enum") != "value":
        return request.value_raw
    return request.value


Fields = dict[str, Any]
"""Fields of a response, by name."""
TaskHandler = Callable[[DeviceState, SimulatedTask, Any], Fields | None]
"""Answers a call about a task from its request; None is an empty response."""
DeviceHandler = Callable[[DeviceState, Any], Fields | None]
"""Answers a call about the device from its request; None is an empty response."""


class Property(NamedTuple):
    """How the calls about one property are answered; what a client does not set has no function for that."""

    get: Callable[[DeviceState, Any], Any]
    """Its value, from device and request; None where the product, task or channel does not have it."""
    put: Callable[[DeviceState, SimulatedTask, Any, Any], None] | None = None
    """Sets it, from device, task, request and value."""


REFUSALS = (DaqStatusError, SessionRefused, ServerGone)


class Metadatum(NamedTuple):
    """One entry of trailing metadata."""

    key: str
    value: str


def rpc_status(error: Exception) -> tuple[grpc.StatusCode, str, tuple[Metadatum, ...]]:
    """Return the gRPC status, text and trailing metadata (NI's error code, samples read) by which a client sees a
    refusal of the driver or server, or a server that is gone; any other exception is raised again."""
    if isinstance(error, DaqStatusError):
        numbers = {"ni-error": error.code, "ni-samps-per-chan-read": error.samples_read}
        metadata = tuple(Metadatum(key, str(number)) for key, number in numbers.items() if number is not None)
        return grpc.StatusCode.UNKNOWN, str(error), metadata
    if isinstance(error, SessionRefused):
        return grpc.StatusCode[error.code], str(error), ()
    if isinstance(error, ServerGone):
        return grpc.StatusCode.UNAVAILABLE, f"failed to connect: {error}", ()
    raise error


INITIALIZE_NEW, ATTACH_TO_EXISTING = 1, 2  # initialization behaviors; 0 attaches where a session exists


def open_session(device: DeviceState, request: Any, create: Callable[[], SimulatedTask]) -> Fields:
    """Attach a client to the task that its request names, or make one by ``create``, as the request's initialization
    behavior says; return the answer's fields: the task's name, whether it is new. Refuse as NI's server does."""
    name, behavior = request.session_name, request.initialization_behavior
    if behavior == INITIALIZE_NEW and name in device.tasks:
        raise SessionRefused("ALREADY_EXISTS", f"Cannot initialize '{name}' when a session already exists.")
    if behavior == ATTACH_TO_EXISTING and name not in device.tasks:
        detail = f"Cannot attach to '{name}' because a session has not been initialized."
        raise SessionRefused("FAILED_PRECONDITION", detail)
    found = device.tasks.get(name)
    return {"task": {"name": (found or create()).name}, "new_session_initialized": found is None}
