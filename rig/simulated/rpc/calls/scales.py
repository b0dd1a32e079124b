"""Calls about custom scales: created by name, their properties, and the inverse of a polynomial."""

from __future__ import annotations

from typing import Any

import numpy as np
from nidaqmx.constants import UnitsPreScaled

from rig.simulated import daqmx
from rig.simulated.device.scales import LINEAR, MAP, POLYNOMIAL, TABLE, CustomScale, find_scale
from rig.simulated.device.state import DeviceState
from rig.simulated.rpc.messages import DeviceHandler, Fields, Key, Properties, enum, property_number
from rig.simulated.status import Code, DaqStatusError, one_of

_FIELDS: dict[str, tuple[int, dict[str, str]]] = {
    "CreateLinScale": (LINEAR, {"slope": "LIN_SLOPE", "y_intercept": "LIN_Y_INTERCEPT"}),
    "CreateMapScale": (
        MAP,
        {
            "prescaled_min": "MAP_PRE_SCALED_MIN",
            "prescaled_max": "MAP_PRE_SCALED_MAX",
            "scaled_min": "MAP_SCALED_MIN",
            "scaled_max": "MAP_SCALED_MAX",
        },
    ),
    "CreatePolynomialScale": (
        POLYNOMIAL,
        {"forward_coeffs": "POLY_FORWARD_COEFF", "reverse_coeffs": "POLY_REVERSE_COEFF"},
    ),
    "CreateTableScale": (TABLE, {"prescaled_vals": "TABLE_PRE_SCALED_VALS", "scaled_vals": "TABLE_SCALED_VALS"}),
}
"""Type of the scale and property of each field of the request, by call."""
UNITS = tuple(unit.value for unit in UnitsPreScaled)
"""Units of what a scale can be given; a channel takes those of what it measures."""
_NAMES = {property_number("Scale", name): name for _, fields in _FIELDS.values() for name in fields.values()}
_TYPE, _PRESCALED_UNITS = property_number("Scale", "TYPE"), property_number("Scale", "PRE_SCALED_UNITS")
_OWN = {
    _TYPE: "type",
    property_number("Scale", "DESCR"): "description",
    property_number("Scale", "SCALED_UNITS"): "scaled_units",
    _PRESCALED_UNITS: "prescaled_units",
}
"""What every scale has, by the field of :class:`CustomScale`."""


def _create(call: str) -> DeviceHandler:
    type_, fields = _FIELDS[call]

    def create(device: DeviceState, request: Any) -> None:
        if not request.name.strip():
            raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, "a scale needs a name")
        one_of(enum(request, "pre_scaled_units") or daqmx.VOLTS, UNITS, "Pre-scaled units")
        values = {name: _plain(getattr(request, field)) for field, name in fields.items()}
        scale = CustomScale(
            request.name, type_, values, enum(request, "pre_scaled_units") or daqmx.VOLTS, request.scaled_units
        )
        scale.check()
        device.scales[request.name.lower()] = scale

    return create


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, (int, float)) else [float(one) for one in value]


def _get(device: DeviceState, request: Any, key: Key) -> Any:
    scale, number = find_scale(device.scales, request.scale_name), key[1]
    if number in _OWN:
        return getattr(scale, _OWN[number])
    if (value := scale.values.get(_NAMES.get(number, ""))) is None:
        raise DaqStatusError(Code.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE, f"Property: 0x{number:04X} of {scale.name}")
    return value


def _put(device: DeviceState, request: Any, key: Key, value: Any) -> None:
    scale, number = find_scale(device.scales, request.scale_name), key[1]
    if number in _OWN and number != _TYPE:
        if number == _PRESCALED_UNITS:
            one_of(value, UNITS, "Pre-scaled units")
        setattr(scale, _OWN[number], value)
    elif (name := _NAMES.get(number, "")) in scale.values:
        before = scale.values[name]
        scale.values[name] = _plain(value)
        try:
            scale.check()
        except DaqStatusError:
            scale.values[name] = before
            raise
    else:
        raise DaqStatusError(Code.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE, f"Property: 0x{number:04X} of {scale.name}")


def _reverse(device: DeviceState, request: Any) -> Fields:
    """Fit the inverse of a polynomial over a range, as the driver does, by least squares."""
    n = request.num_points_to_compute
    order = len(request.forward_coeffs) - 1 if request.reverse_poly_order < 0 else request.reverse_poly_order
    if not request.forward_coeffs or n <= order or request.min_val_x >= request.max_val_x:
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"{n} points for an inverse of order {order}")
    x = np.linspace(request.min_val_x, request.max_val_x, n)
    y = np.polynomial.polynomial.polyval(x, list(request.forward_coeffs))
    return {"reverse_coeffs": np.polynomial.polynomial.polyfit(y, x, order).tolist()}


SCALE_CALLS: dict[str, DeviceHandler] = {
    **{call: _create(call) for call in _FIELDS},
    "CalculateReversePolyCoeff": _reverse,
}
SCALE_PROPERTIES = Properties(_get, _put)
