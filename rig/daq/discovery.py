"""What stands behind an NI-DAQmx driver or server: devices, modules, serial numbers, driver version."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import grpc
import nidaqmx.errors
from nidaqmx.system import Device, System

from rig.daq.faults import translate_faults
from rig.daq.tasks import session_options

T = TypeVar("T")


@dataclass(frozen=True)
class FoundDevice:
    """A card, a chassis or a module: ``serial_number`` 0 is a simulated one; ``slot`` 0 is no module."""

    name: str
    product: str
    serial_number: int
    simulated: bool
    slot: int = 0
    modules: tuple[FoundDevice, ...] = ()

    @property
    def serial(self) -> str:
        """Serial number as NI prints it, in hexadecimal digits; ``none (simulated)`` without one."""
        if self.serial_number:
            return f"{self.serial_number:08X}"
        return "none (simulated)" if self.simulated else "none"

    def __iter__(self) -> Iterator[FoundDevice]:
        yield self
        yield from self.modules


def _system(channel: grpc.Channel | None) -> System:
    options = session_options(channel)
    return System.local() if options is None else System.remote(options)


def find_device(channel: grpc.Channel | None, name: str) -> FoundDevice:
    """Return product, serial number and, of a chassis, the modules by slot of the device ``name``; ``channel`` None is
    this computer's driver, else a server's. HardwareFault where there is none of that name."""
    with translate_faults("connect", f"device {name}"):
        device = Device(name, grpc_options=session_options(channel))
        chassis: list[Device] = _ask_or_default(lambda: list(device.chassis_module_devices), [])
        modules = [
            FoundDevice(
                m.name, str(m.product_type), int(m.serial_num), bool(m.is_simulated), int(m.compact_daq_slot_num)
            )
            for m in chassis
        ]
        return FoundDevice(
            name,
            str(device.product_type),
            _ask_or_default(lambda: int(device.serial_num), 0),
            bool(device.is_simulated),
            modules=tuple(sorted(modules, key=lambda module: module.slot)),
        )


def _ask_or_default(ask: Callable[[], T], otherwise: T) -> T:
    """Return the answer, or ``otherwise`` where the device does not have the property."""
    with contextlib.suppress(nidaqmx.errors.DaqError):
        return ask()
    return otherwise


def driver_version(channel: grpc.Channel | None) -> str:
    with translate_faults("connect", "NI-DAQmx driver"):
        version = _system(channel).driver_version
    return ".".join(str(int(part)) for part in version)


def find_devices(channel: grpc.Channel | None) -> list[FoundDevice]:
    with translate_faults("connect", "list of devices"):
        names = _system(channel).devices.device_names
    found = [find_device(channel, name) for name in names]
    inside = {module.name for device in found for module in device.modules}
    return [device for device in found if device.name not in inside]
