"""Calls of a DAQmx client about what is no task: the system and its devices, watchdogs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import control_watchdog, set_expiration_level, set_expiration_volts, watchdog_timer
from rig.simulated.driver import create_task, create_watchdog_task, reset_device
from rig.simulated.product import Inventory, Kind, channel_names
from rig.simulated.rpc.messages import Fields, Property, enum, open_session
from rig.simulated.status import Code, DaqStatusError

X_SERIES, CHASSIS, MODULE = 15858, 14658, 14659
E_SERIES, TIO_SERIES, AO_SERIES = 14642, 14661, 14647
CATEGORIES = {"PCI-6034E": E_SERIES, "PCI-6602": TIO_SERIES, "PCI-6733": AO_SERIES}

Answer = Callable[[Inventory, str], Any]
"""From the device that was asked, with its modules, and its name or that of a module."""


def device_property(answer: Answer) -> Property:
    """Read-only property of a device: ``answer`` gives it from the inventory of the card or chassis and the name that
    the client asked by, which may be a module's; an unknown name is refused."""

    def get(device: DeviceState, request: Any) -> Any:
        name = request.device_name
        asked = device.inventory.owner_of(name)
        known = {known.lower(): known for known in asked.own_devices()}
        if name.lower() not in known:
            raise DaqStatusError(Code.INVALID_DEVICE_ID, f"Device: {name}")
        return answer(asked, known[name.lower()])

    return Property(get)


def channels_getter(*kinds: Kind) -> Answer:
    """Getter of the names, with commas between, of the channels of these kinds that a device has; asked by a module's
    name it gives that module's only."""

    def get(device: Inventory, name: str) -> str:
        names = [one for one in device.names(*kinds) if device.owner_of(one) is device]
        if name in _modules(device):
            names = [channel for channel in names if channel.startswith(name + "/")]
        return ", ".join(names)

    return get


def list_ports(device: Inventory, name: str) -> str:
    lines = filter(None, channels_getter("line", "static_line")(device, name).split(", "))
    return ", ".join(dict.fromkeys(line.rsplit("/line", 1)[0] for line in lines))


def _modules(device: Inventory) -> list[str]:
    return list(device.own_devices())[1:]


def product_category(device: Inventory, name: str) -> int:
    if name in _modules(device):
        return MODULE
    return CHASSIS if device.product.chassis else CATEGORIES.get(device.product.name, X_SERIES)


def module_names(device: Inventory, name: str) -> str | None:
    return ", ".join(_modules(device)) if name == device.name and device.product.chassis else None


def slot_number(device: Inventory, name: str) -> int | None:
    return _modules(device).index(name) + 1 if name in _modules(device) else None


def has_simultaneous_sampling(device: Inventory, name: str) -> bool | None:
    """Whether a card has a converter for each input; on a chassis that belongs to the modules."""
    has_inputs = any(kind == "voltage_in" for _, kind, _ in device.product.channels)
    return False if has_inputs and not device.product.chassis else None


VERSION = {"NIDAQ_MAJOR_VERSION": 26, "NIDAQ_MINOR_VERSION": 0, "NIDAQ_UPDATE_VERSION": 0}
"""Version of NI-DAQmx that the virtual device behaves like."""


def version_property(number: int) -> Property:
    return Property(lambda device, request: number)


def open_task(device: DeviceState, request: Any) -> Fields:
    return open_session(device, request, lambda: create_task(device, request.session_name))


def open_watchdog(device: DeviceState, request: Any) -> Fields:
    _refuse_other_device(device, request.device_name)
    name, timeout_s = request.session_name, request.timeout
    return open_session(device, request, lambda: create_watchdog_task(device, name, timeout_s, request.device_name))


def reset_named_device(device: DeviceState, request: Any) -> None:
    _refuse_other_device(device, request.device_name)
    reset_device(device, device.inventory.owner_of(request.device_name))


def _refuse_other_device(device: DeviceState, name: str) -> None:
    if name.lower() != device.inventory.owner_of(name).name.lower():
        raise DaqStatusError(Code.INVALID_DEVICE_ID, f"Device: {name}")


def _pair_states(request: Any, *arrays: Any) -> Any:
    names = channel_names(request.channel_names)
    if any(len(array) != len(names) for array in arrays):
        raise DaqStatusError(Code.INVALID_ATTRIBUTE_VALUE, f"Expiration states for {len(names)} channels")
    return zip(names, *arrays, strict=True)


def set_analog_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for channel, volts, kind in _pair_states(request, request.expir_state_array, request.output_type_array):
        set_expiration_volts(device, timer, channel, volts, kind)


def set_line_states(device: DeviceState, request: Any) -> None:
    timer = watchdog_timer(device, request.task.name)
    for line, level in _pair_states(request, request.expir_state_array):
        set_expiration_level(device, timer, line, level)


def control_timer(device: DeviceState, request: Any) -> None:
    control_watchdog(device, watchdog_timer(device, request.task.name), enum(request, "action"))


def has_expired(device: DeviceState, request: Any) -> bool:
    timer = watchdog_timer(device, request.task.name)
    if device.tasks[request.task.name].state == "unreserved":
        code = Code.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING
        raise DaqStatusError(code, f"Task: {request.task.name}")
    return timer.expired
