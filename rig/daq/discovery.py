"""What stands behind an NI-DAQmx driver or server: devices, modules, serial numbers, driver version.

A server keeps its sessions when a client dies, and refuses their names to the next. So a recording marks its sessions
by one more, named after rig and computer, and holds a lock file on this computer while it lives. Who gets the lock and
finds the mark knows that the program that made it is dead, that it was this rig's and this computer's, and clears what
it left. Other sessions are never touched.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import grpc
import nidaqmx
import nidaqmx.errors
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.system import Device, System

from rig.configuration.rig_file import RigConfig, load_rig
from rig.daq import safe_bench, tasks
from rig.daq.faults import translate_faults
from rig.daq.safe_bench import WATCHDOG
from rig.daq.tasks import session_options
from rig.errors import ResourceBusy, RigInputError
from rig.platform_calls import lock, open_raw

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
    """Return one device and, of a chassis, its modules; raises HardwareFault where the driver has none of that name."""
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


PATTERNS = {"cDAQ-9189": "virtual", "PCIe-6363": "pcie6363"}
"""Built-in rig file of each product."""
MODULES = {"Mod1": ("NI 9237", "load cell"), "Mod2": ("NI 9263", "motor"), "Mod3": ("NI 9411", "encoders"),
           "Mod4": ("NI 9401", "drive enable and camera")}  # fmt: skip
"""Modules of the pattern for a chassis: product, what it is for."""


def propose_rig(found: Sequence[FoundDevice], name: str | None = None) -> str:
    """Return the text of a rig file for one of the devices found: ``name``, or the first that can be used."""
    usable = [device for device in found if device.product in PATTERNS and name in (None, device.name)]
    if not usable:
        there = ", ".join(f"{device.name} ({device.product})" for device in found) or "none"
        wanted = " or ".join(PATTERNS) + (f" named {name}" if name else "")
        raise RigInputError(f"devices found: {there}; a rig file can be proposed for a {wanted}")
    device = usable[0]
    pattern = load_rig(PATTERNS[device.product])
    body = pattern.text[pattern.text.index("schema = ") :]
    own_name = re.sub(r"\W", "_", device.name).lower()
    body = re.sub(r'(?m)^name = "\w+"$', f'name = "{own_name}"', body, count=1)
    renamed = _pair_device_names(device, pattern.config.device.name)
    any_name = "|".join(map(re.escape, renamed))  # all at once: a found name may be another one of the pattern
    return _rig_file_comments(device) + re.sub(rf"\b({any_name})\b", lambda match: renamed[match[0]], body)


def _pair_device_names(device: FoundDevice, pattern_name: str) -> dict[str, str]:
    """Return the names found by those of the pattern, modules first; refuse a device that lacks a module."""
    renamed = {}
    if device.modules:
        for slot, (product, purpose) in MODULES.items():
            fitting = [module for module in device.modules if module.product == product]
            if not fitting:
                there = ", ".join(f"{module.product} in slot {module.slot}" for module in device.modules)
                raise RigInputError(f"{device.name}: has no {product} ({purpose}); found are {there}")
            renamed[f"{pattern_name}{slot}"] = fitting[0].name
    return {**renamed, pattern_name: device.name}


def _rig_file_comments(device: FoundDevice) -> str:
    """Comment lines at the head of a proposed rig file."""
    lines = [
        f"# Proposed by  pianorig info --propose  for {device.name}, {device.product}, serial number {device.serial}.",
        *(f"#   slot {m.slot}: {m.name}, {m.product}, serial number {m.serial}" for m in device.modules),
        "# Device names are those found. Everything else is the pattern's; look at it before anything moves:",
        "# terminals, scales, counts per revolution, signs, limits, uncertainties, certificates, the arm.",
    ]
    return "\n".join(lines) + "\n"


_TAKEN = grpc.StatusCode.ALREADY_EXISTS
_CHECKED = (tasks.MASTER, tasks.EDGES, tasks.CAMERA, tasks.MOTOR, tasks.VOLTAGE)
SESSIONS = (
    *(WATCHDOG, tasks.MOTOR, tasks.MASTER, safe_bench.ZERO, safe_bench.DRIVE, tasks.CAMERA, tasks.EDGES),
    *(tasks.OPPOSITE, *map(tasks.CHECK.format, _CHECKED)),
)
"""Sessions that a recording or a self-test opens, beside those of the encoders."""


class ServerClaim:
    """The claim of one recording on the sessions of its rig at a server."""

    def __init__(self, channel: grpc.Channel, target: str) -> None:
        self._channel, self._target = channel, target
        self._mark: nidaqmx.Task | None = None
        self._lock: int | None = None

    def take(self, config: RigConfig) -> bool:
        """Claim the sessions; return whether those of a program that died were cleared for it."""
        if self._mark is not None:
            return False
        self._take_lock(config)

        def session(name: str, behavior: SessionInitializationBehavior) -> nidaqmx.Task:
            return nidaqmx.Task(name, grpc_options=tasks.session_options(self._channel, name, behavior))

        mark = re.sub(r"\W", "_", f"pianorig_{config.name}_on_{platform.node()}")
        with translate_faults("connect", f"server {self._target}"):
            try:
                self._mark = session(mark, tasks.NEW)
                return False
            except nidaqmx.errors.RpcError as error:
                if error.rpc_code not in (_TAKEN, _TAKEN.value[0]):
                    raise
            self._mark = session(mark, tasks.ATTACHED)
            for name in (*SESSIONS, *map(tasks.encoder_task_name, config.encoders)):
                with contextlib.suppress(nidaqmx.errors.Error):  # it did not get as far as opening this one
                    session(name, tasks.ATTACHED).close()
        return True

    def release(self) -> None:
        """Close the mark at the server and unlock the device on this computer."""
        mark, self._mark = self._mark, None
        with contextlib.suppress(nidaqmx.errors.Error, grpc.RpcError):  # a server that is gone keeps nothing
            if mark is not None:
                mark.close()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _take_lock(self, config: RigConfig) -> None:
        """Lock the device on this computer; `ResourceBusy` where another program holds it."""
        key = hashlib.sha256(f"{self._target} {config.device.name}".encode()).hexdigest()[:16]
        path = Path(tempfile.gettempdir()) / f"pianorig-{key}.lock"
        descriptor = open_raw(path, os.O_RDWR | os.O_CREAT)
        if not lock(descriptor):
            os.close(descriptor)
            raise ResourceBusy(
                f"device {config.device.name} at {self._target}: another program on this computer records with it; "
                "end that first",
                phase="connect",
            )
        self._lock = descriptor
