"""The virtual bench as a server that runs until it is told to stop, with its own time and its own watchdog.

Place in the data flow: ``pianorig serve-sim`` → this → :mod:`rig.simulated.rpc.tcp_server`. Every 10 ms it looks at the
watchdog, whether or not a client calls, so that outputs become safe when the client is dead, and lets generations go
on while no client waits; and it can tell an observer, one line per change, whether the motor's output is live.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlencode

from rig.configuration.rig_file import load_rig
from rig.safety.interrupts import termination_as_interrupt
from rig.simulated.backend import open_backend
from rig.simulated.device.device import SimulatedDevice
from rig.simulated.rpc.tcp_server import serve

LOOK_EVERY_S = 0.01
BEHIND_S = 0.05
"""Time a client may leave to pass before the bench goes on without it."""


def output_state(device: SimulatedDevice) -> dict[str, object]:
    """Return what decides whether the motor can move: volts (live or not), drive, watchdog; and the trial."""
    volts = device.output_v.get(device.inventory.full_name(device.wiring.motor), 0.0)
    return {
        "trial": device.trial,
        "motor": "live" if volts != 0.0 else "0 V",
        "drive": "enabled" if device.drive_enabled() else "disabled",
        "watchdog": "tripped" if device.watchdogs.expired else "quiet",
    }


def _keep_up(device: SimulatedDevice) -> None:
    """Let outputs go on while nobody waits; an acquisition waits for its reader, so that its samples can be counted."""
    clock = device.bench.clock
    acquiring = any(task.live and task.buffer is not None for task in device.tasks.values())
    if clock.paced and clock.due_s > BEHIND_S and not acquiring:
        device.advance(int(clock.due_s * device.bench.rate_hz))


def serve_until_interrupted(
    rig: str | Path = "virtual",
    *,
    host: str = "127.0.0.1",
    port: int = 31763,
    clock: str = "real",
    seed: int | None = None,
    bench: Path | None = None,
    fault: str | None = None,
    hand: bool = False,
    announce: Callable[[str, str, str], None],
    tell: Callable[[dict[str, object]], None] | None = None,
    stop: threading.Event | None = None,
) -> None:
    """Serve the virtual device of a rig file until Ctrl-C, SIGTERM or ``stop``.

    Parameters
    ----------
    announce : callable
        Called once with address, product and device name when clients can connect.
    tell : callable, optional
        Called with :func:`output_state`, time and samples acquired at every change of the outputs.

    Raises
    ------
    InputError
        Bad rig file, bench file, clock or fault.
    HardwareFault
        When the address cannot be bound.
    """
    config = load_rig(rig).config
    options = {"clock": clock, "seed": seed, "bench": bench, "fault": fault, "hand": "yes" if hand else None}
    url = "sim://?" + urlencode({key: value for key, value in options.items() if value is not None})
    backend = open_backend(url, config)
    server, bound = serve(backend.service, host=host, port=port)
    device, stop = backend.device, stop or threading.Event()
    announce(f"{host}:{bound}", device.inventory.product.name, device.inventory.name)
    last: dict[str, object] = {}
    try:
        with contextlib.suppress(KeyboardInterrupt), termination_as_interrupt():
            while not stop.wait(LOOK_EVERY_S):
                with backend.service.alone():
                    device.watchdogs.look()
                    _keep_up(device)
                    state, edge = output_state(device), device.edge
                if tell is not None and state != last:
                    tell({**state, "samples": edge, "time_s": round(device.bench.clock.elapsed_s, 4)})
                    last = state
    finally:
        server.stop(None).wait()
