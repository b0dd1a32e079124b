"""The virtual bench as a server that runs until it is stopped, with its own time and its own watchdogs.

``pianorig serve-sim`` calls this; clients talk to :mod:`rig.simulated.rpc.tcp_server`. Every 10 ms it checks the
watchdogs, whether or not a client calls, so that outputs become safe when the client is dead, and lets the device go
on while no client waits; and it can report to an observer, one line per change, whether the motor's output is live.
"""

from __future__ import annotations

import contextlib
import ipaddress
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

from rig.configuration.rig_file import load_rig
from rig.errors import RigInputError
from rig.safety.interrupts import termination_as_interrupt
from rig.simulated.backend import open_backend
from rig.simulated.device.state import DeviceState
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.rpc.tcp_server import Tls, serve
from rig.simulated.timing import go_on

CHECK_EVERY_S = 0.01
BEHIND_S = 0.05
"""Time a client may leave to pass before the bench goes on without it."""


@dataclass(frozen=True)
class ServeOptions:
    """Which bench is served, and where; the options of a ``sim://`` address beside rig file, host and port."""

    rig: str | Path = "virtual"
    host: str = "127.0.0.1"
    port: int = 31763
    """0 takes a free one."""
    clock: str = "real"
    seed: int | None = None
    bench: Path | None = None
    fault: str | None = None
    hand: bool = False
    """Whether the virtual operator acts in a self-test."""
    allow_network: bool = False
    """Whether others than this computer may be let in."""
    tls: Tls | None = None
    felt: str | None = None
    """What is under the arm in place of the key: the felt of a contact, or ``block``."""

    @property
    def on_network(self) -> bool:
        """Whether the address can be reached from other computers."""
        try:
            return not ipaddress.ip_address(self.host.strip("[]")).is_loopback
        except ValueError:
            return self.host.lower() != "localhost"

    @property
    def address(self) -> str:
        """The ``sim://`` address of the bench."""
        options = {
            "clock": self.clock, "seed": self.seed, "bench": self.bench, "fault": self.fault,
            "hand": "yes" if self.hand else None, "felt": self.felt,
        }  # fmt: skip
        return "sim://?" + urlencode({key: value for key, value in options.items() if value is not None})


def output_state(device: DeviceState) -> dict[str, object]:
    """Return what decides whether the motor can move: volts (live or not), drive, watchdog; and the trial."""
    return {
        "trial": device.trial,
        "motor": "live" if device.output_v.get(device.motor, 0.0) != 0.0 else "0 V",
        "drive": "enabled" if device.drive_enabled() else "disabled",
        "watchdog": "tripped" if any(timer.expired for timer in device.watchdogs.values()) else "quiet",
    }


def serve_until_interrupted(
    options: ServeOptions,
    announce: Callable[[str, str, str], None],
    report: Callable[[dict[str, object]], None] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the virtual device of a rig file until Ctrl-C, SIGTERM or ``stop``.

    Parameters
    ----------
    options : ServeOptions
        Bench and address.
    announce : callable
        Called once with address, product and device name when clients can connect.
    report : callable, optional
        Called with :func:`output_state`, time, and the samples handed out and acquired, at every change of the outputs.
    stop : threading.Event, optional
        Ends the server when it is set.

    Raises
    ------
    RigInputError
        Bad rig file, bench file, clock or fault; an address on the network that was not allowed.
    HardwareFault
        When the address cannot be bound.

    Examples
    --------
    >>> import threading
    >>> from rig.simulated import ServeOptions, serve_until_interrupted
    >>> stop = threading.Event()
    >>> def announce(address, product, device):
    ...     print(product)
    ...     stop.set()
    >>> serve_until_interrupted(ServeOptions(rig="pcie6363", port=0), announce, stop=stop)
    PCIe-6363
    """
    if options.on_network and not options.allow_network:
        raise RigInputError(
            f"host {options.host}: other computers could drive the bench; allowed is the loopback, e.g. 127.0.0.1, "
            "or  --allow-network  beside it (with --tls, and --tls-client-ca to know who calls)"
        )
    backend = open_backend(options.address, load_rig(options.rig).config)
    server, bound = serve(backend.service, host=options.host, port=options.port, tls=options.tls)
    device, stop = backend.device, stop or threading.Event()
    announce(f"{options.host}:{bound}", device.inventory.product.name, device.inventory.name)
    last: dict[str, object] = {}
    try:
        with contextlib.suppress(KeyboardInterrupt), termination_as_interrupt():
            while not stop.wait(CHECK_EVERY_S):
                with backend.service.exclusive():
                    check_watchdogs(device)
                    if device.bench.clock.due_s > BEHIND_S:
                        go_on(device)
                    state = output_state(device)
                    samples = {"samples": device.handed_out, "acquired": device.edge}
                if report is not None and state != last:
                    report({**state, **samples, "time_s": round(device.bench.clock.elapsed_s, 4)})
                    last = state
    finally:
        server.stop(None).wait()
