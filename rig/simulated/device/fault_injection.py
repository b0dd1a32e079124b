"""Faults injected into the virtual bench, by time or by call: what goes wrong in a lab, on demand.

The service asks the plan before each call; passing time lets it change what stands at the sensors' terminals. Faults
are written ``KIND@TRIAL/SECONDS``, ``KIND:BODY@TRIAL/SECONDS`` or ``KIND@CALL#NUMBER``, several with commas, in the
option ``fault`` of a ``sim://`` address; e.g. ``sim://?fault=stuck:hammer@2/0.4,reserved@TaskControl%231``.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.simulated.bench.bench_time import BenchTime
from rig.simulated.bench.plant_protocol import ENCODED_BODIES
from rig.simulated.device.task import SimulatedTask
from rig.simulated.status import Code, DaqStatusError, ServerGone

STATUS = {
    "overwrite": Code.SAMPLES_NO_LONGER_AVAILABLE,
    "timeout": Code.SAMPLES_NOT_YET_AVAILABLE,
    "underrun": Code.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES,
    "reserved": Code.PAL_RESOURCE_RESERVED,
    "device-lost": Code.DEV_CANNOT_BE_ACCESSED,
}
LASTING = ("device-lost", "server-gone", "underrun")
CELL = ("bridge-open", "saturated", "silent")
SCALE = ("stuck", "miscount")
CAMERA = ("dropped",)
SENSORS = (*CELL, *SCALE, *CAMERA)
KINDS = (*STATUS, "server-gone", *SENSORS)
DROPPED_FRAMES = 5
LOST_COUNTS = 300
OPEN_MV_PER_V = 1e4
SILENT_NOISE_MV_PER_V = 3e-4
_FORM = re.compile(r"([a-z-]+)(?::([a-z]+))?@(?:(\d+)/(\d+(?:\.\d+)?)|([A-Za-z0-9]+)#(\d+))")


@dataclass(frozen=True)
class Fault:
    """One fault: from ``at_s`` of trial ``trial`` on, or from the ``number``-th call named ``call`` on."""

    kind: str
    body: str = ""
    trial: int = 0
    at_s: float = 0.0
    call: str = ""
    number: int = 0


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Read faults from text; raises RigInputError in one line."""
    faults = []
    for part in filter(None, text.split(",")):
        match = _FORM.fullmatch(part)
        kind, body, trial, at_s, call, number = match.groups() if match else ("",) * 6
        if match is None or kind not in KINDS or (kind in SCALE) != (body in ENCODED_BODIES):
            raise RigInputError(
                f"fault {part!r}: write KIND@TRIAL/SECONDS or KIND@CALL#NUMBER with a kind of {', '.join(KINDS)}, "
                f"and :BODY ({', '.join(ENCODED_BODIES)}) behind {' and '.join(SCALE)}"
            )
        faults.append(Fault(kind, body or "", int(trial or 0), float(at_s or 0), call or "", int(number or 0)))
    return tuple(faults)


class FaultyDevice(Protocol):
    """What a fault can see and change of the device (:class:`rig.simulated.device.state.DeviceState`)."""

    bench: BenchTime
    tasks: dict[str, SimulatedTask]
    trial: int


class FaultPlan:
    """The faults of a bench, and which of them have struck."""

    def __init__(self, faults: tuple[Fault, ...] = ()) -> None:
        self.faults = faults
        self._calls: Counter[str] = Counter()
        self._struck: set[Fault] = set()
        self._held: dict[Fault, float] = {}

    def before_call(self, call: str, device: FaultyDevice, timeout_s: float = 0.0) -> None:
        """Raise what is due before a call is answered that would wait ``timeout_s``."""
        self._calls[call] += 1
        for index, fault in enumerate(self.faults):
            if fault in self._struck:
                if fault.kind in LASTING:
                    self._fail(fault, call)
            elif fault.kind in SENSORS and fault.call and self._due(fault, call, device):
                faults = list(self.faults)
                faults[index] = replace(fault, call="", number=0, trial=device.trial, at_s=device.bench.now_s)
                self.faults = tuple(faults)
            elif fault.kind not in SENSORS and self._due(fault, call, device):
                if fault.kind == "underrun":
                    for task in device.tasks.values():
                        task.progress.live &= task.type != "AO"  # the output keeps the volts it has
                elif fault.kind == "timeout":
                    device.bench.clock.advance(max(timeout_s, 0.0))  # nothing ticks: the outputs keep their values
                self._struck.add(fault)
                self._fail(fault, call)

    def _due(self, fault: Fault, call: str, device: FaultyDevice) -> bool:
        if fault.call:
            return call == fault.call and self._calls[call] >= fault.number
        late = device.trial == fault.trial and device.bench.edge >= fault.at_s * device.bench.rate_hz
        return late and (call.startswith("Read") or fault.kind not in ("overwrite", "timeout"))

    def _fail(self, fault: Fault, call: str) -> None:
        if fault.kind == "server-gone":
            raise ServerGone("planted")
        if fault.kind == "underrun" and call != "IsTaskDone":
            return  # the driver reports it to a client that asks about the output task
        raise DaqStatusError(STATUS[fault.kind], "planted", samples_read=0 if call.startswith("Read") else None)

    def exposures(self, trial: int, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the exposures of the camera by each time, (n,), without those that it dropped."""
        for fault in self.faults:
            if fault.kind in CAMERA and trial == fault.trial:
                at = self._held.get(fault)
                if at is None and (time_s >= fault.at_s).any():
                    at = self._held[fault] = float(count[time_s >= fault.at_s][0])
                if at is not None:
                    late = np.maximum(np.minimum(count, int(at)), count - DROPPED_FRAMES)
                    count = np.where(time_s >= fault.at_s, late, count)
        return count

    def change(
        self, trial: int, time_s: NDArray[np.float64], cell: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return cell output (n,) and counts (n, 3) as the faulty sensors give them."""
        for fault in self.faults:
            after = time_s >= fault.at_s
            if trial != fault.trial or fault.kind not in (*CELL, *SCALE) or not after.any():
                continue
            cell, counts = cell.copy(), counts.copy()
            if fault.kind == "bridge-open":
                cell[after] = OPEN_MV_PER_V
            elif fault.kind == "saturated":
                cell[after] = self._held.setdefault(fault, float(cell[after][0]))
            elif fault.kind == "silent":
                noise = np.random.default_rng(int(time_s[0] * 1e6)).standard_normal(int(after.sum()))
                cell[after] = SILENT_NOISE_MV_PER_V * noise
            else:
                column = ENCODED_BODIES.index(fault.body)
                if fault.kind == "stuck":
                    counts[after, column] = int(self._held.setdefault(fault, float(counts[after, column][0])))
                else:
                    counts[after, column] -= LOST_COUNTS
        return cell, counts
