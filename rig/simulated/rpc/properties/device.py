"""Properties of the served devices, the card or the chassis and its modules, by the driver's number.

They come from the product's table; what is not in it is refused, never answered with an invented value.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rig.simulated import status
from rig.simulated.product.capabilities import Kind
from rig.simulated.product.inventory import DIGITAL_RATE_HZ
from rig.simulated.status import DaqStatusError

if TYPE_CHECKING:
    from rig.simulated.device.device import SimulatedDevice

X_SERIES, CHASSIS, MODULE = 15858, 14658, 14659
PCIE, TCPIP = 13612, 14828
COUNTER_BITS = 32
Property = Callable[["SimulatedDevice", str], Any]


def _channels(*kinds: Kind) -> Property:
    def get(device: SimulatedDevice, name: str) -> str:
        names = device.inventory.names(*kinds)
        if name in dict(_modules(device)):
            names = [channel for channel in names if channel.startswith(name + "/")]
        return ", ".join(names)

    return get


def _ports(device: SimulatedDevice, name: str) -> str:
    lines = filter(None, _channels("line", "static_line")(device, name).split(", "))
    return ", ".join(dict.fromkeys(line.rsplit("/line", 1)[0] for line in lines))


def _modules(device: SimulatedDevice) -> list[tuple[str, str]]:
    return list(device.inventory.devices().items())[1:]


def _category(device: SimulatedDevice, name: str) -> int:
    if name in dict(_modules(device)):
        return MODULE
    return CHASSIS if device.inventory.product.modules else X_SERIES


def _card(get: Callable[[Any], Any]) -> Property:
    """A property that only a card has for itself; on a chassis it belongs to modules and tasks."""

    def find(device: SimulatedDevice, name: str) -> Any:
        product = device.inventory.product
        return None if product.modules else get(product)

    return find


def _of_module(get: Callable[[SimulatedDevice, str], Any]) -> Property:
    return lambda device, name: get(device, name) if name in dict(_modules(device)) else None


def _both_signs(halves: tuple[float, ...]) -> list[float]:
    return [value for half in halves for value in (-half, half)]


DEVICE_GETTABLE: dict[int, Property] = {
    0x0631: lambda device, name: device.inventory.devices()[name],
    0x22CA: lambda device, name: True,  # it says what it is
    0x0632: lambda device, name: 0,  # a simulated device has no serial number
    0x29A9: _category,
    0x2326: lambda device, name: TCPIP if device.inventory.product.modules else PCIE,
    0x231E: _channels("bridge", "voltage_in"),
    0x231F: _channels("voltage_out"),
    0x2320: _channels("line", "static_line"),
    0x2322: _channels("line", "static_line"),
    0x2321: _ports,
    0x2323: _ports,
    0x2324: _channels("counter"),
    0x2325: _channels("counter"),
    0x29B6: lambda device, name: ", ".join(dict(_modules(device))) if name == device.inventory.name else "",
    0x29B7: _of_module(lambda device, name: device.inventory.name),
    0x29B8: _of_module(lambda device, name: [module for module, _ in _modules(device)].index(name) + 1),
    0x2984: _card(lambda product: True),
    0x2985: _card(lambda product: True),
    0x298C: _card(lambda product: product.ai_max_rate_hz),
    0x298D: _card(lambda product: product.ai_aggregate_rate_hz),
    0x298E: _card(lambda product: product.timebase_hz / 2**32),
    0x298F: _card(lambda product: False),
    0x2990: _card(lambda product: _both_signs(product.ai_ranges_v)),
    0x2996: _card(lambda product: True),
    0x2997: _card(lambda product: product.ao_max_rate_hz),
    0x2998: _card(lambda product: product.timebase_hz / 2**32),
    0x2999: _card(lambda product: DIGITAL_RATE_HZ),
    0x299A: _card(lambda product: DIGITAL_RATE_HZ),
    0x299B: _card(lambda product: _both_signs((5.0, product.ao_range_v))),
    0x299E: _card(lambda product: True),
    0x299F: _card(lambda product: COUNTER_BITS),
    0x29A0: _card(lambda product: product.counter_timebase_hz),
    0x29A1: _card(lambda product: COUNTER_BITS),
    0x29A2: _card(lambda product: product.counter_timebase_hz),
}


def device_property(device: SimulatedDevice, name: str, attribute: int) -> Any:
    """Return a property of the card, the chassis or a module; refuses other devices and unknown properties."""
    known = {known.lower(): known for known in device.inventory.devices()}
    if name.lower() not in known:
        raise DaqStatusError(status.INVALID_DEVICE, f"Device: {name}")
    value = DEVICE_GETTABLE[attribute](device, known[name.lower()]) if attribute in DEVICE_GETTABLE else None
    if value is None:
        raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{attribute:04X} of {name}")
    return value
