"""The protobuf messages of NI's DAQmx service and of its session utilities, found by the name of the call.

No other module touches the generated classes: they are private parts of ``nidaqmx`` (pinned >= 1.7, < 2). A test checks
that every call the virtual device answers exists.
"""

from __future__ import annotations

import math
from typing import Any

import session_pb2
from nidaqmx._stubs import nidaqmx_pb2

from rig.simulated import status
from rig.simulated.status import DaqStatusError

SERVICE = "nidaqmx_grpc.NiDAQmx"
_METHODS = nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"].methods_by_name
CALLS: frozenset[str] = frozenset(_METHODS)
"""Names of all calls of the service."""
UTILITIES = "nidevice_grpc.SessionUtilities"
_UTILITY_METHODS = session_pb2.DESCRIPTOR.services_by_name["SessionUtilities"].methods_by_name
UTILITY_CALLS: frozenset[str] = frozenset(_UTILITY_METHODS)


def request_class(call: str) -> Any:
    """Return the message class of a call's request."""
    return getattr(nidaqmx_pb2, _METHODS[call].input_type.name)


def utility_request_class(call: str) -> Any:
    """Return the message class of the request of a session utility."""
    return getattr(session_pb2, _UTILITY_METHODS[call].input_type.name)


def utility_response(call: str, **fields: Any) -> Any:
    """Return a response of a session utility with the given fields."""
    return getattr(session_pb2, _UTILITY_METHODS[call].output_type.name)(**fields)


def response(call: str, **fields: Any) -> Any:
    """Return a response of a call with the given fields."""
    return getattr(nidaqmx_pb2, _METHODS[call].output_type.name)(**fields)


_KINDS: dict[str, type | tuple[type, ...]] = {
    "String": str, "Bool": bool, "Int32": int, "UInt32": int, "UInt64": int, "Double": float, "Array": list,
}  # fmt: skip


def attribute_fields(call: str, value: Any) -> dict[str, Any]:
    """Return the response's fields of a Get…Attribute call; refuses a property of another type than the call's."""
    kind = next(kind for kind in ("Array", "UInt32", "UInt64", *_KINDS) if call.endswith(kind))
    if not isinstance(value, _KINDS[kind]) or (kind != "Bool" and isinstance(value, bool)):
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"{call}: the property is of another type")
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
                raise DaqStatusError(status.INVALID_VALUE, f"{field.name}: {value}")


def enum(request: Any, field: str) -> int:
    """Return an enumeration field, given as the enumeration or as a raw number."""
    return int(getattr(request, field + "_raw") or getattr(request, field))


def attribute_value(request: Any) -> Any:
    """Return the value of a Set…Attribute request, given as such or as a raw number."""
    names = {field.name for field in request.DESCRIPTOR.fields}
    if "value_raw" in names and request.WhichOneof("value_enum") != "value":
        return request.value_raw
    return request.value
