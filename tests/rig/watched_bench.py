"""The bench of a ``sim://`` address, served; a JSON line at every change of its outputs."""

from __future__ import annotations

import json
import runpy
import sys
import time
from pathlib import Path
from typing import Any

import rig
from rig import open_backend
from rig.safety.interrupts import termination_as_interrupt

SERVE_SIM = Path(__file__).parents[2] / "examples" / "serve_sim.py"
CHECK_EVERY_S = 0.01


def output_state(device: Any) -> dict[str, object]:
    """Return what decides whether the motor can move: volts (live or not), drive, watchdog; and the trial."""
    return {
        "trial": device.trial,
        "motor": "live" if device.output_v.get(device.motor, 0.0) != 0.0 else "0 V",
        "drive": "enabled" if device.drive_enabled() else "disabled",
        "watchdog": "tripped" if any(timer.expired for timer in device.watchdogs.values()) else "quiet",
    }


def main(bench: str) -> None:
    """Serve until the program is ended."""
    backend = open_backend(bench, rig.load_rig("virtual").config)
    server, port = runpy.run_path(str(SERVE_SIM))["serve"](backend.service)
    print(json.dumps({"address": f"127.0.0.1:{port}"}), flush=True)
    device, last = backend.device, None
    with termination_as_interrupt():
        try:
            while True:
                time.sleep(CHECK_EVERY_S)
                backend.service.let_time_pass()
                with backend.service.exclusive():
                    state = output_state(device)
                    counted = {"samples": device.handed_out, "time_s": round(device.bench.clock.elapsed_s, 4)}
                if state != last:
                    print(json.dumps({**state, **counted}), flush=True)
                    last = state
        except KeyboardInterrupt:
            server.stop(None).wait()


if __name__ == "__main__":
    main(sys.argv[1])
