"""Calls of a DAQmx client about what is no task: the system and its devices, physical channels, scales, watchdogs.

Properties of devices (the card, or the chassis and its modules) come from the product's table. A simulated device keeps
no calibration: the driver answers with zeros and the recommended interval, and takes a self-calibration without effect.
Nothing is saved on the virtual system, so every name of a saved thing is unknown.

Starting, stopping and clearing a watchdog timer task are the calls of any task.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from nidaqmx.constants import UnitsPreScaled

from rig.simulated import daqmx
from rig.simulated.device.scales import LINEAR, MAP, POLYNOMIAL, TABLE, CustomScale, find_scale
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import (
    control_watchdog,
    refuse_bad_timer,
    set_expiration_level,
    set_expiration_volts,
    watchdog_timer,
)
from rig.simulated.driver import create_task, create_watchdog_task, reset_device
from rig.simulated.product import DIGITAL_RATE_HZ, Inventory, Kind, PhysicalChannel, channel_names
from rig.simulated.rpc.messages import DeviceHandler, Fields, Key, Properties, enum, open_session, property_number
from rig.simulated.status import Code, DaqStatusError, Unsupported, one_of, text_of

X_SERIES, CHASSIS, MODULE = 15858, 14658, 14659
PCIE, TCPIP = 13612, 14828
E_SERIES, TIO_SERIES, AO_SERIES = 14642, 14661, 14647
PCI = 12582
CATEGORIES = {"PCI-6034E": E_SERIES, "PCI-6602": TIO_SERIES, "PCI-6733": AO_SERIES}
COUNTER_BITS = 32


Property = Callable[[Inventory, str], Any]
"""From the device that was asked, with its modules, and its name or that of a module."""


def _channels(*kinds: Kind) -> Property:
    def get(device: Inventory, name: str) -> str:
        names = [one for one in device.names(*kinds) if device.of(one) is device]
        if name in dict(_modules(device)):
            names = [channel for channel in names if channel.startswith(name + "/")]
        return ", ".join(names)

    return get


def _ports(device: Inventory, name: str) -> str:
    lines = filter(None, _channels("line", "static_line")(device, name).split(", "))
    return ", ".join(dict.fromkeys(line.rsplit("/line", 1)[0] for line in lines))


def _modules(device: Inventory) -> list[tuple[str, str]]:
    return list(device.own_devices().items())[1:]


def _category(device: Inventory, name: str) -> int:
    if name in dict(_modules(device)):
        return MODULE
    product = device.product
    return CHASSIS if product.chassis else CATEGORIES.get(product.name, X_SERIES)


def _card(get: Callable[[Any], Any], kind: Kind | None = None) -> Property:
    """A property that only a card with channels of this kind has; on a chassis it belongs to modules and tasks."""

    def find(device: Inventory, name: str) -> Any:
        product = device.product
        has = kind is None or any(kind == one for _, one, _ in product.channels)
        return get(product) if has and not product.chassis else None

    return find


def _of_module(get: Callable[[Inventory, str], Any]) -> Property:
    return lambda device, name: get(device, name) if name in dict(_modules(device)) else None


def _both_signs(halves: tuple[float, ...]) -> list[float]:
    return [value for half in halves for value in (-half, half)]


_GETTERS: dict[str, Property] = {
    "PRODUCT_TYPE": lambda device, name: device.own_devices()[name],
    "IS_SIMULATED": lambda device, name: True,  # it does not pretend to be hardware
    "SERIAL_NUM": lambda device, name: 0,  # a simulated device has no serial number
    "PRODUCT_CATEGORY": _category,
    "BUS_TYPE": lambda device, name: (
        TCPIP if device.product.chassis else PCI if device.product.name in CATEGORIES else PCIE
    ),
    "AI_PHYSICAL_CHANS": _channels("bridge", "voltage_in"),
    "AO_PHYSICAL_CHANS": _channels("voltage_out"),
    "DI_LINES": _channels("line", "static_line"),
    "DO_LINES": _channels("line", "static_line"),
    "DI_PORTS": _ports,
    "DO_PORTS": _ports,
    "CI_PHYSICAL_CHANS": _channels("counter"),
    "CO_PHYSICAL_CHANS": _channels("counter"),
    "CHASSIS_MODULE_DEV_NAMES": lambda device, name: (
        ", ".join(dict(_modules(device))) if name == device.name and device.product.chassis else None
    ),
    "COMPACT_DAQ_CHASSIS_DEV_NAME": _of_module(lambda device, name: device.name),
    "COMPACT_DAQ_SLOT_NUM": _of_module(lambda device, name: [module for module, _ in _modules(device)].index(name) + 1),
    "ANLG_TRIG_SUPPORTED": _card(lambda product: product.apfi),
    "DIG_TRIG_SUPPORTED": _card(lambda product: True),
    "AI_MAX_SINGLE_CHAN_RATE": _card(lambda product: product.ai_max_rate_hz, "voltage_in"),
    "AI_MAX_MULTI_CHAN_RATE": _card(lambda product: product.ai_aggregate_rate_hz, "voltage_in"),
    "AI_MIN_RATE": _card(lambda product: product.timebase_hz / 2**32, "voltage_in"),
    "AI_SIMULTANEOUS_SAMPLING_SUPPORTED": _card(lambda product: False, "voltage_in"),
    "AI_VOLTAGE_RNGS": _card(lambda product: _both_signs(product.ai_ranges_v), "voltage_in"),
    "AO_SAMP_CLK_SUPPORTED": _card(lambda product: True, "voltage_out"),
    "AO_MAX_RATE": _card(lambda product: product.ao_max_rate_hz, "voltage_out"),
    "AO_MIN_RATE": _card(lambda product: product.timebase_hz / 2**32, "voltage_out"),
    "DI_MAX_RATE": _card(lambda product: DIGITAL_RATE_HZ, "line"),
    "DO_MAX_RATE": _card(lambda product: DIGITAL_RATE_HZ, "line"),
    "AO_VOLTAGE_RNGS": _card(lambda product: _both_signs((5.0, 10.0) if product.apfi else (10.0,)), "voltage_out"),
    "CI_SAMP_CLK_SUPPORTED": _card(lambda product: True),
    "CI_MAX_SIZE": _card(lambda product: COUNTER_BITS),
    "CI_MAX_TIMEBASE": _card(lambda product: product.counter_timebase_hz),
    "CO_MAX_SIZE": _card(lambda product: COUNTER_BITS),
    "CO_MAX_TIMEBASE": _card(lambda product: product.counter_timebase_hz),
}
_GETTER_OF_NUMBER = {property_number("Device", name): getter for name, getter in _GETTERS.items()}


def device_property(device: DeviceState, name: str, attribute: int) -> Any:
    """Return a property of the card, the chassis or a module; refuses other devices and unknown properties."""
    asked = device.inventory.of(name)
    known = {known.lower(): known for known in asked.own_devices()}
    if name.lower() not in known:
        raise DaqStatusError(Code.INVALID_DEVICE_ID, f"Device: {name}")
    getter = _GETTER_OF_NUMBER.get(attribute)
    value = getter(asked, known[name.lower()]) if getter else None
    if value is None:
        raise Unsupported(f"Property: 0x{attribute:04X} of {name}")
    return value


MONTHS = 24
"""Recommended interval of calibration of an X Series card."""
_DEV_NAMES = property_number("System", "DEV_NAMES")
_SYSTEM = {
    property_number("System", name): value
    for name, value in (
        ("NIDAQ_MAJOR_VERSION", 26), ("NIDAQ_MINOR_VERSION", 0), ("NIDAQ_UPDATE_VERSION", 0),
        ("GLOBAL_CHANS", ""), ("SCALES", ""), ("TASKS", ""),
    )
}  # fmt: skip
"""Version of NI-DAQmx that the virtual device behaves like, and what is saved on the system: nothing."""
_CALIBRATION = {
    property_number("CalibrationInfo", name): value
    for name, value in (
        ("CAL_DEV_TEMP", 0.0), ("EXT_CAL_LAST_TEMP", 0.0), ("SELF_CAL_LAST_TEMP", 0.0),
        ("EXT_CAL_RECOMMENDED_INTERVAL", MONTHS),
    )
}  # fmt: skip
RSE, NRSE, DIFFERENTIAL = 1, 2, 4
"""Bits of the terminal configurations an input can have."""
TERMINALS = property_number("PhysicalChannel", "PHYSICAL_CHAN_AI_TERM_CFGS")
CHANGE_DETECTION = property_number("PhysicalChannel", "PHYSICAL_CHAN_DI_CHANGE_DETECT_SUPPORTED")


def refuse_other_device(device: DeviceState, name: str) -> None:
    """Refuse the name of a device that is none of those served."""
    if name.lower() != device.inventory.of(name).name.lower():
        raise DaqStatusError(Code.INVALID_DEVICE_ID, f"Device: {name}")


def _reset(device: DeviceState, request: Any) -> None:
    refuse_other_device(device, request.device_name)
    reset_device(device, device.inventory.of(request.device_name))


def _of_card(device: DeviceState, request: Any) -> None:
    refuse_other_device(device, request.device_name)
    if device.inventory.of(request.device_name).product.chassis:
        raise Unsupported(f"Device: {request.device_name}: a module is calibrated")


DEVICE_CALLS: dict[str, DeviceHandler] = {
    "CreateTask": lambda device, request: open_session(
        device, request, lambda: create_task(device, request.session_name)
    ),
    "GetErrorString": lambda device, request: {"error_string": text_of(request.error_code)},
    "ResetDevice": _reset,
    "SelfTestDevice": lambda device, request: refuse_other_device(device, request.device_name),
    "SelfCal": _of_card,
    "RestoreLastExtCalConst": _of_card,
}


def _calibration_property(device: DeviceState, request: Any, key: Key) -> float | int | None:
    _of_card(device, request)
    return _CALIBRATION.get(key[1])


def _find(device: DeviceState, name: str) -> PhysicalChannel:
    for kind in ("voltage_in", "bridge", "voltage_out", "counter", "line", "static_line"):
        try:
            return device.inventory.channel(name, kind)
        except DaqStatusError as refused:
            if refused.code not in (Code.PHYS_CHAN_MEAS_TYPE, Code.PHYS_CHAN_OUTPUT_TYPE):
                break
    raise DaqStatusError(Code.PHYSICAL_CHAN_DOES_NOT_EXIST, f"Physical Channel: {name}")


def _physical_channel_property(device: DeviceState, request: Any, key: Key) -> int | bool | None:
    channel = _find(device, request.physical_channel)
    product = device.inventory.of(channel.name).product
    if key[1] == TERMINALS and channel.kind == "voltage_in":
        paired = int(channel.resource.removeprefix("ai")) in product.differential
        return RSE | NRSE | (DIFFERENTIAL if paired else 0)
    if key[1] == CHANGE_DETECTION and channel.kind in ("line", "static_line"):
        return product.change_detection and channel.kind == "line"
    return None


def _saved(code: int, field: str) -> Properties:
    def refuse(device: DeviceState, request: Any, key: Key) -> None:
        raise DaqStatusError(code, f"{getattr(request, field)!r} is not saved on this system")

    return Properties(refuse)


DEVICE_PROPERTIES = {
    "SystemInfo": Properties(
        lambda device, request, key: (
            ", ".join(device.inventory.devices()) if key[1] == _DEV_NAMES else _SYSTEM.get(key[1])
        )
    ),
    "Device": Properties(lambda device, request, key: device_property(device, request.device_name, key[1])),
    "CalInfo": Properties(_calibration_property),
    "PhysicalChan": Properties(_physical_channel_property),
    "PersistedChan": _saved(Code.INVALID_GLOBAL_CHAN, "channel"),
    "PersistedScale": _saved(Code.CUSTOM_SCALE_DOES_NOT_EXIST, "scale_name"),
    "PersistedTask": _saved(Code.TASK_NOT_IN_DATA_NEIGHBORHOOD, "task_name"),
}


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


def _create_scale(call: str) -> DeviceHandler:
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


def _get_scale(device: DeviceState, request: Any, key: Key) -> Any:
    scale, number = find_scale(device.scales, request.scale_name), key[1]
    if number in _OWN:
        return getattr(scale, _OWN[number])
    if (value := scale.values.get(_NAMES.get(number, ""))) is None:
        raise DaqStatusError(Code.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE, f"Property: 0x{number:04X} of {scale.name}")
    return value


def _put_scale(device: DeviceState, request: Any, key: Key, value: Any) -> None:
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
    **{call: _create_scale(call) for call in _FIELDS},
    "CalculateReversePolyCoeff": _reverse,
}
SCALE_PROPERTIES = Properties(_get_scale, _put_scale)


DEFAULT_TIMEOUT_S = 10.0
TIMEOUT = property_number("Watchdog", "TIMEOUT")
LINE_STATE = property_number("Watchdog", "DO_EXPIR_STATE")
RISING = 10280
KEPT: dict[int, str | int] = {
    property_number("Watchdog", "DIG_EDGE_WATCHDOG_EXPIR_TRIG_EDGE"): RISING,
    property_number("Watchdog", "DIG_EDGE_WATCHDOG_EXPIR_TRIG_SRC"): "",
}
"""Settings of an expiration by a trigger, with their defaults; a timer with such a trigger is refused when started."""
HAS_EXPIRED = property_number("Watchdog", "HAS_EXPIRED")


def _create_timer(device: DeviceState, request: Any) -> Fields:
    refuse_other_device(device, request.device_name)
    name, timeout_s = request.session_name, request.timeout
    return open_session(device, request, lambda: create_watchdog_task(device, name, timeout_s, request.device_name))


def _states(request: Any, *arrays: Any) -> Any:
    names = channel_names(request.channel_names)
    if any(len(array) != len(names) for array in arrays):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Expiration states for {len(names)} channels")
    return zip(names, *arrays, strict=True)


def _analog_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for channel, volts, kind in _states(request, request.expir_state_array, request.output_type_array):
        set_expiration_volts(device, timer, channel, volts, kind)


def _digital_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for line, level in _states(request, request.expir_state_array):
        set_expiration_level(device, timer, line, level)


def _get_timer(device: DeviceState, request: Any, key: Key) -> Any:
    timer, number = watchdog_timer(device, request.task.name), key[1]
    if number == TIMEOUT:
        return timer.timeout_s
    if number == HAS_EXPIRED:
        if device.tasks[request.task.name].state == "unreserved":
            code = Code.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING
            raise DaqStatusError(code, f"Task: {request.task.name}")
        return timer.expired
    if number == LINE_STATE:
        return timer.levels.get(device.inventory.channel(request.lines, "line").name)
    return timer.settings.get(number, KEPT.get(number))


def _put_timer(device: DeviceState, request: Any, key: Key, value: Any) -> None:
    timer, number = watchdog_timer(device, request.task.name), key[1]
    device.tasks[request.task.name].refuse_while_running()
    if number == TIMEOUT and isinstance(value, int | float):
        refuse_bad_timer(device.inventory.of(timer.device), request.task.name, float(value))
        timer.timeout_s = float(value)
    elif number == LINE_STATE and isinstance(value, int):
        set_expiration_level(device, timer, request.lines, value)
    elif number in KEPT and type(value) is type(KEPT[number]):
        timer.settings[number] = value
    else:
        raise Unsupported(f"Property: 0x{number:04X} (Watchdog)")


def _reset_timer(device: DeviceState, request: Any, key: Key) -> None:
    defaults = {**KEPT, TIMEOUT: DEFAULT_TIMEOUT_S, LINE_STATE: daqmx.NO_CHANGE}
    _put_timer(device, request, key, defaults.get(key[1]))


WATCHDOG_CALLS: dict[str, DeviceHandler] = {
    "CreateWatchdogTimerTaskEx": _create_timer,
    "CfgWatchdogAOExpirStates": _analog_states,
    "CfgWatchdogDOExpirStates": _digital_states,
    "ControlWatchdogTask": lambda device, request: control_watchdog(
        device, watchdog_timer(device, request.task.name), enum(request, "action")
    ),
}
WATCHDOG_PROPERTIES = Properties(_get_timer, _put_timer, _reset_timer)
