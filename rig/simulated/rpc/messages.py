"""The protobuf messages of NI's DAQmx service and of its session utilities, found by the name of the call.

No other module touches the generated classes: they are private parts of ``nidaqmx`` (pinned >= 1.7, < 2). A test checks
that every call the virtual device answers exists.

Here too: what a handler of a call is (a function from device, task and request to the fields of the response), how a
refusal travels to a client (gRPC status, text and trailing metadata, as NI's server sends them), and whether a client
gets a new session or attaches to one that exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import grpc
import session_pb2
from google.protobuf.message_factory import GetMessageClass
from nidaqmx._stubs import nidaqmx_pb2

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.status import Code, DaqStatusError, ServerGone, SessionRefused, Unsupported

SERVICE = "nidaqmx_grpc.NiDAQmx"
_METHODS = nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"].methods_by_name
CALLS: frozenset[str] = frozenset(_METHODS)
"""Names of all calls of the service."""
UTILITIES = "nidevice_grpc.SessionUtilities"
_UTILITY_METHODS = session_pb2.DESCRIPTOR.services_by_name["SessionUtilities"].methods_by_name
UTILITY_CALLS: frozenset[str] = frozenset(_UTILITY_METHODS)
_EVERY = {**_METHODS, **_UTILITY_METHODS}


def request_class(call: str) -> Any:
    """Return the message class of a call's request."""
    return GetMessageClass(_EVERY[call].input_type)


def response(call: str, **fields: Any) -> Any:
    """Return a response of a call with the given fields."""
    return GetMessageClass(_EVERY[call].output_type)(**fields)


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
    """Return the driver's number of a property, e.g. of ``SAMP_CLK_RATE`` in category ``Timing``."""
    prefix = {"Chan": "CHANNEL", "Trig": "TRIGGER", "ExportedSignal": "EXPORTSIGNAL"}.get(category, category.upper())
    return int(getattr(nidaqmx_pb2, f"{prefix}_ATTRIBUTE_{name}"))


def refuse_not_finite(request: Any) -> None:
    """Refuse a setting that is infinite or not a number, as the driver does for every property."""
    for field, value in request.ListFields():
        if field.cpp_type == field.CPPTYPE_DOUBLE:
            numbers = [value] if isinstance(value, float) else value
            if not all(map(math.isfinite, numbers)):
                raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{field.name}: {value}")


def enum(request: Any, field: str) -> int:
    """Return an enumeration field, given as the enumeration or as a raw number."""
    return int(getattr(request, field + "_raw") or getattr(request, field))


def attribute_value(request: Any) -> Any:
    """Return the value of a Set…Attribute request, given as such or as a raw number."""
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
Key = tuple[str, int]
"""Category and the driver's number of a property."""


class Properties(NamedTuple):
    """What answers the calls about one category of properties; what cannot be set or reset has no function for it."""

    get: Callable[[DeviceState, Any, Key], Any]
    """Its value from device and request; None where the product, task or channel does not have it."""
    put: Callable[[DeviceState, Any, Key, Any], None] | None = None
    reset: Callable[[DeviceState, Any, Key], None] | None = None


REFUSALS = (DaqStatusError, SessionRefused, ServerGone)


class Metadatum(NamedTuple):
    """One entry of trailing metadata."""

    key: str
    value: str


def rpc_status(error: Exception) -> tuple[grpc.StatusCode, str, tuple[Metadatum, ...]]:
    """Return the gRPC status, text and trailing metadata by which a client sees one of :data:`REFUSALS`."""
    if isinstance(error, DaqStatusError):
        numbers = {
            "ni-error": error.code,
            "ni-samps-per-chan-read": error.samples_read,
            "ni-samps-per-chan-written": error.samples_written,
        }
        metadata = tuple(Metadatum(key, str(number)) for key, number in numbers.items() if number is not None)
        return grpc.StatusCode.UNKNOWN, str(error), metadata
    if isinstance(error, SessionRefused):
        return grpc.StatusCode[error.code], str(error), ()
    if isinstance(error, ServerGone):
        return grpc.StatusCode.UNAVAILABLE, f"failed to connect: {error}", ()
    raise error


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
