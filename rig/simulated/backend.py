"""Assembly of the virtual bench behind a ``sim://`` address: plant, sensors, device, service, channel, real client.

Options of the address, e.g. ``sim://?bench=PATH&seed=3&clock=real``:

- ``bench``: bench file (default: the built-in one); ``seed`` overrides its seed;
- ``clock``: ``virtual`` (default), ``real``, or a speed such as ``10``;
- ``fault``: faults to inject (:mod:`rig.simulated.device.state`);
- ``scene=string``: the specimen's scene, a built-in one or a TOML file (`model.scene.selection`);
- ``effects=balance_rail,shank``: the specimen's key can lift and its shank bend, beside what its scene says;
- ``delay_ms=20``: every driver call takes so long, as over a slow network;
- ``felt=contact02``: not the action but the specimen's felt of that contact, or a ``block`` of steel, is under the
  motor arm, as ``pianorig record --felt`` has it;
- ``swing=hammer``: the body hangs on its joint alone, is let go and swings, as ``pianorig calibrate joint`` has it;
- ``pad=contact04:0.2:0.005`` with it: that contact's materials rub on a drum about the axis under 0.2 N at 5 mm, as
  ``pianorig calibrate contact`` has it;
- ``pose=key:0,0.01``: the body is held at these angles one after the other, as ``pianorig calibrate encoder`` has it;
- ``hand=yes``: the virtual operator acts when a self-test asks for it; ``hand=plays``: a virtual pianist plays where
  the motor has no task.

The device takes product and name from the rig file.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from rig.atomic_write import sha256_of_file
from rig.backend import Capabilities, Opener
from rig.configuration.rig_file import RigConfig
from rig.daq import NidaqmxBackend
from rig.errors import RigInputError
from rig.simulated.bench.bench_time import BenchTime
from rig.simulated.bench.clock import PacedClock, VirtualClock
from rig.simulated.bench.felt_plant import make_felt_plant
from rig.simulated.bench.plant import load_plant
from rig.simulated.bench.plant_protocol import Plant, read_bench
from rig.simulated.bench.pose_plant import make_pose_plant
from rig.simulated.bench.sensors import SensorSet, load_sensors
from rig.simulated.bench.swing_plant import make_swing_plant
from rig.simulated.bench.wiring import Wiring, plant_wiring_faults, usual_wiring
from rig.simulated.device.faults import parse_faults
from rig.simulated.device.state import DeviceState, FaultPlan
from rig.simulated.product import PRODUCTS, Inventory
from rig.simulated.rpc.messages import CALLS
from rig.simulated.rpc.service import Service, in_process_channel

DEFAULT_BENCH = Path(__file__).parent / "bench.toml"
OPTIONS = ("bench", "seed", "clock", "fault", "scene", "effects", "felt", "swing", "pad", "pose", "hand", "delay_ms")
CLOCK_ERRORS = (0.0, 3.5e-5, -2.2e-5)
"""Relative errors of the timebases of the rig's devices; NI specifies 50 ppm for these cards."""
CAMERA_CLOCK_ERROR = 4e-5  # relative error of the rate of a camera that runs by itself


class SimulatedBackend(NidaqmxBackend):
    """The NI-DAQmx backend on a virtual bench; ``plant`` and ``device`` can be inspected after a trial."""

    def __init__(self, device: DeviceState, description: dict[str, str] | None = None) -> None:
        self.device = device
        self.plant: Plant = device.bench.plant
        self.service = Service(device)
        super().__init__(in_process_channel(self.service), name="virtual bench")
        self._bench = description or {}

    def wait(self, duration_s: float) -> None:
        """Let time pass between two trials on the bench's own clock; a virtual clock costs the operator none."""
        self.device.bench.clock.advance(duration_s)

    def _now_s(self) -> float:
        """Return the bench's time, by which the virtual watchdogs run."""
        return self.device.bench.clock.elapsed_s

    def continue_after(self, trial: int) -> None:
        """Continue after a session's last trial, so that what is recorded next does not repeat its scatter."""
        self.device.trial = trial

    @property
    def capabilities(self) -> Capabilities:
        """What this backend is."""
        inherited = super().capabilities
        return replace(inherited, simulated=True, hardware=False, description={**inherited.description, **self._bench})


def build_device(
    config: RigConfig,
    plant: Plant,
    sensors: SensorSet,
    *,
    clock: VirtualClock | None = None,
    wiring: Wiring | None = None,
) -> DeviceState:
    """Assemble the virtual device of a rig file: product and names from ``config``, the moving ``plant`` and its
    ``sensors`` wired to the terminals (by ``wiring`` or as usual), time from ``clock`` (by default it costs no real
    time). It has no task.

    Parameters
    ----------
    config : RigConfig
    plant : Plant
        The moving parts.
    sensors : SensorSet
        What they read as.
    clock : VirtualClock, optional
        By default one that runs as fast as it is read.
    wiring : Wiring, optional
        By default the product's usual one.

    Returns
    -------
    DeviceState

    Examples
    --------
    >>> import rig
    >>> from rig.simulated import build_device, load_plant
    >>> from rig.simulated.backend import DEFAULT_BENCH
    >>> from rig.simulated.bench.sensors import load_sensors
    >>> plant = load_plant(DEFAULT_BENCH, seed=1, sample_rate_hz=5000.0)
    >>> build_device(rig.load_rig("virtual").config, plant, load_sensors(DEFAULT_BENCH, seed=1)).inventory.name
    'cDAQ1'
    """
    wiring = wiring or usual_wiring(config)
    inventory = _make_inventory(config, wiring.rtsi)
    device = DeviceState(inventory, BenchTime(plant, sensors, clock or VirtualClock()), wiring)
    if config.camera is not None and config.camera.mode == "counted":
        device.bench.camera_rate_hz = config.camera.frame_rate_hz * (1 + CAMERA_CLOCK_ERROR)
    return device


def _make_inventory(config: RigConfig, rtsi: bool) -> Inventory:
    """Channels and terminals of the rig file's main device with its further devices, each with a timebase error of its
    own; ``rtsi``: the cards that can are joined by one RTSI cable."""
    named = [(config.device.product, config.device.name), *((one.product, one.name) for one in config.devices)]
    on_cable = [name for product, name in named if PRODUCTS[product].rtsi and rtsi]
    first, *others = (
        (PRODUCTS[product], name, CLOCK_ERRORS[k % len(CLOCK_ERRORS)]) for k, (product, name) in enumerate(named)
    )
    return Inventory(*first, [Inventory(*other) for other in others], on_cable)


def open_backend(url: str, config: RigConfig) -> SimulatedBackend:
    """Build a virtual bench in this process from ``sim://?options`` (no server, no network), wired as ``config`` says;
    close it after use.

    Parameters
    ----------
    url : str
        ``sim://``, with options such as ``sim://?seed=7&clock=real&effects=balance_rail``.
    config : RigConfig

    Returns
    -------
    SimulatedBackend

    Raises
    ------
    RigInputError
        For an unknown option or a bad bench file.

    Examples
    --------
    >>> import rig
    >>> bench = rig.simulated.open_backend("sim://?seed=7", rig.load_rig("virtual").config)
    >>> bench.capabilities.hardware
    False
    >>> bench.close()
    """
    options = _parse_options(url)
    alone = [name for name in ("felt", "swing", "pose") if options.get(name)]
    if len(alone) > 1 or ("pad" in options and alone != ["swing"]):
        raise RigInputError(f"{url}: allowed one of felt, swing and pose, and pad beside swing")
    bench = Path(options["bench"]) if options.get("bench") else DEFAULT_BENCH
    if not bench.is_file():
        raise RigInputError(f"{url}: bench file {bench} does not exist")
    seed = _read(url, "seed", options["seed"]) if "seed" in options else None
    clock = _read(url, "clock", options.get("clock", "virtual"))
    faults = parse_faults(options.get("fault", ""))
    if unknown := {fault.call for fault in faults if fault.call} - CALLS:
        raise RigInputError(f"{url}: fault at {', '.join(sorted(unknown))}: no call of NI-DAQmx's gRPC service")
    sensors = load_sensors(bench, seed=seed)
    effects = [name for name in options.get("effects", "").split(",") if name]
    mechanics = load_plant(bench, seed, config.device.sample_rate_hz, effects, options.get("scene"))
    plant: Plant = mechanics
    if options.get("felt"):
        plant = make_felt_plant(mechanics, options["felt"], config)
    elif options.get("swing"):
        plant = make_swing_plant(mechanics, options["swing"], options.get("pad", ""))
    elif options.get("pose"):
        plant = make_pose_plant(mechanics, options["pose"], url)
    table = read_bench(bench).get("wiring", {})
    wiring = plant_wiring_faults(table if isinstance(table, dict) else {"": table}, usual_wiring(config), str(bench))
    device = build_device(config, plant, sensors, clock=clock, wiring=wiring)
    device.faults = FaultPlan(faults)
    device.call_delay_s = _read(url, "delay_ms", options.get("delay_ms", "0")) / 1e3
    hand = _read(url, "hand", options.get("hand", "no"))
    device.bench.force_per_volt_n = mechanics.torque_per_volt_nm / mechanics.action["motor_arm.length"]
    device.bench.operator_acts, device.bench.pianist_plays = hand == "yes", hand == "plays"
    backend = SimulatedBackend(
        device,
        {
            "bench": bench.name,
            "bench_sha256": sha256_of_file(bench),
            "seed": str(sensors.seed),
            **({"felt": options["felt"]} if options.get("felt") else {}),
            **({"specimen_scene": options["scene"]} if options.get("scene") else {}),
            **({"specimen_effects": ", ".join(effects)} if effects else {}),
        },
    )
    backend.identify(config)
    return backend


OPENER: Opener = open_backend
"""What the entry point ``sim`` promises, for the type checker."""


def _parse_options(url: str) -> dict[str, str]:
    """Options of a ``sim://`` address by name, as text; refuse another address, unknown and repeated ones."""
    parts = urlsplit(url)
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    unknown = sorted({key for key, _ in pairs} - set(OPTIONS))
    if parts.scheme != "sim" or parts.netloc or parts.path.strip("/") or unknown or len(dict(pairs)) != len(pairs):
        raise RigInputError(
            f"backend address {url!r}: allowed is sim://?… with the options {', '.join(OPTIONS)}, each once"
        )
    return dict(pairs)


def _read_whole_number(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise ValueError
    return int(text)


def _read_number_within(text: str, low: float, high: float) -> float:
    value = float(text)
    if not low <= value <= high:
        raise ValueError
    return value


READERS: dict[str, tuple[Callable[[str], Any], str]] = {
    "seed": (_read_whole_number, "a whole number from 0"),
    "delay_ms": (lambda text: _read_number_within(text, 0, 10_000), "0 to 10000"),
    "hand": (lambda text: {one: one for one in ("yes", "no", "plays")}[text], "yes, no or plays"),
    "clock": (
        lambda text: (
            VirtualClock()
            if text == "virtual"
            else PacedClock(1.0 if text == "real" else _read_number_within(text, math.ulp(0.0), sys.float_info.max))
        ),
        "virtual, real, or a speed above 0",
    ),
}
"""What reads the text of an option, and what is allowed."""


def _read(url: str, name: str, text: str) -> Any:
    read, allowed = READERS[name]
    try:
        return read(text)
    except (ValueError, KeyError):
        raise RigInputError(f"{url}: {name} = {text!r}, allowed {allowed}") from None
