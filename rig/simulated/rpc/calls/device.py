"""Calls of a DAQmx client about the system, its devices and their physical channels: new tasks, properties, reset.

Properties of devices (the card, or the chassis and its modules) come from the product's table. A simulated device keeps
no calibration: the driver answers with zeros and the recommended interval, and takes a self-calibration without effect.
Nothing is saved on the virtual system, so every name of a saved thing is unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.driver import create_task, reset_device
from rig.simulated.product.capabilities import Kind
from rig.simulated.product.inventory import DIGITAL_RATE_HZ, Inventory, PhysicalChannel
from rig.simulated.rpc.messages import DeviceHandler, Key, Properties, open_session, property_number
from rig.simulated.status import TEXTS, Code, DaqStatusError, Unsupported

X_SERIES, CHASSIS, MODULE = 15858, 14658, 14659
PCIE, TCPIP = 13612, 14828
E_SERIES, TIO_SERIES, AO_SERIES = 14642, 14661, 14647
PCI = 12582
CATEGORIES = {"PCI-6034E": E_SERIES, "PCI-6602": TIO_SERIES, "PCI-6733": AO_SERIES}
COUNTER_BITS = 32


@dataclass(frozen=True)
class Named:
    """The device that was asked, with its modules."""

    inventory: Inventory


Property = Callable[[Named, str], Any]


def _channels(*kinds: Kind) -> Property:
    def get(device: Named, name: str) -> str:
        names = [one for one in device.inventory.names(*kinds) if device.inventory.of(one) is device.inventory]
        if name in dict(_modules(device)):
            names = [channel for channel in names if channel.startswith(name + "/")]
        return ", ".join(names)

    return get


def _ports(device: Named, name: str) -> str:
    lines = filter(None, _channels("line", "static_line")(device, name).split(", "))
    return ", ".join(dict.fromkeys(line.rsplit("/line", 1)[0] for line in lines))


def _modules(device: Named) -> list[tuple[str, str]]:
    return list(device.inventory.own_devices().items())[1:]


def _category(device: Named, name: str) -> int:
    if name in dict(_modules(device)):
        return MODULE
    product = device.inventory.product
    return CHASSIS if product.chassis else CATEGORIES.get(product.name, X_SERIES)


def _card(get: Callable[[Any], Any]) -> Property:
    """A property that only a card has for itself; on a chassis it belongs to modules and tasks."""

    def find(device: Named, name: str) -> Any:
        product = device.inventory.product
        return None if product.chassis else get(product)

    return find


def _of_module(get: Callable[[Named, str], Any]) -> Property:
    return lambda device, name: get(device, name) if name in dict(_modules(device)) else None


def _both_signs(halves: tuple[float, ...]) -> list[float]:
    return [value for half in halves for value in (-half, half)]


_GETTERS: dict[str, Property] = {
    "PRODUCT_TYPE": lambda device, name: device.inventory.own_devices()[name],
    "IS_SIMULATED": lambda device, name: True,  # it does not pretend to be hardware
    "SERIAL_NUM": lambda device, name: 0,  # a simulated device has no serial number
    "PRODUCT_CATEGORY": _category,
    "BUS_TYPE": lambda device, name: (
        TCPIP if device.inventory.product.chassis else PCI if device.inventory.product.name in CATEGORIES else PCIE
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
        ", ".join(dict(_modules(device)))
        if name == device.inventory.name and device.inventory.product.chassis
        else None
    ),
    "COMPACT_DAQ_CHASSIS_DEV_NAME": _of_module(lambda device, name: device.inventory.name),
    "COMPACT_DAQ_SLOT_NUM": _of_module(lambda device, name: [module for module, _ in _modules(device)].index(name) + 1),
    "ANLG_TRIG_SUPPORTED": _card(lambda product: True),
    "DIG_TRIG_SUPPORTED": _card(lambda product: True),
    "AI_MAX_SINGLE_CHAN_RATE": _card(lambda product: product.ai_max_rate_hz),
    "AI_MAX_MULTI_CHAN_RATE": _card(lambda product: product.ai_aggregate_rate_hz),
    "AI_MIN_RATE": _card(lambda product: product.timebase_hz / 2**32),
    "AI_SIMULTANEOUS_SAMPLING_SUPPORTED": _card(lambda product: False),
    "AI_VOLTAGE_RNGS": _card(lambda product: _both_signs(product.ai_ranges_v)),
    "AO_SAMP_CLK_SUPPORTED": _card(lambda product: True),
    "AO_MAX_RATE": _card(lambda product: product.ao_max_rate_hz),
    "AO_MIN_RATE": _card(lambda product: product.timebase_hz / 2**32),
    "DI_MAX_RATE": _card(lambda product: DIGITAL_RATE_HZ),
    "DO_MAX_RATE": _card(lambda product: DIGITAL_RATE_HZ),
    "AO_VOLTAGE_RNGS": _card(lambda product: _both_signs((5.0, product.ao_range_v))),
    "CI_SAMP_CLK_SUPPORTED": _card(lambda product: True),
    "CI_MAX_SIZE": _card(lambda product: COUNTER_BITS),
    "CI_MAX_TIMEBASE": _card(lambda product: product.counter_timebase_hz),
    "CO_MAX_SIZE": _card(lambda product: COUNTER_BITS),
    "CO_MAX_TIMEBASE": _card(lambda product: product.counter_timebase_hz),
}
_GETTER_OF_NUMBER = {property_number("Device", name): getter for name, getter in _GETTERS.items()}


def device_property(device: DeviceState, name: str, attribute: int) -> Any:
    """Return a property of the card, the chassis or a module; refuses other devices and unknown properties."""
    asked = Named(device.inventory.of(name))
    known = {known.lower(): known for known in asked.inventory.own_devices()}
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
    "GetErrorString": lambda device, request: {
        "error_string": TEXTS.get(request.error_code, "Error code could not be found.")
    },
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
