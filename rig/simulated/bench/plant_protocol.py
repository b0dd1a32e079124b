"""What the virtual device needs of a plant: the interface between electronics and mechanics; and the bench file.

The device passes in the volts its analog output is at and gets back the state at each edge of the sample clock; sensors
turn that state into millivolts per volt and counts. Time zero is the AI start trigger. The output is a zero-order hold:
sample k is generated at edge k and stays until edge k+1; the command of edge k has not yet acted on the state at edge
k. Force on the key is positive downwards; angles are absolute, in rad, counter-clockwise; encoder order is key,
whippen, hammer. The bench file's TOML tables hold the true values (specimen, motor, sensors, wiring, scatter).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rig.configuration import toml_file
from rig.errors import RigInputError


def read_bench(path: Path) -> dict[str, Any]:
    return toml_file.parse_toml(toml_file.read_text(path), str(path))


def bench_table(bench: dict[str, Any], name: str, where: Path) -> dict[str, Any]:
    table = bench.get(name)
    if not isinstance(table, dict):
        raise RigInputError(f"{where}: [{name}]: missing; the virtual bench needs this table")
    return table


ENCODED_BODIES = ("key", "whippen", "hammer")


@dataclass(frozen=True, eq=False)
class PlantBlock:
    """State of the plant at n successive edges of the sample clock."""

    time_s: NDArray[np.float64]  # (n,), time of each edge since the start trigger, s
    # (n,), force of the motor arm on the key as the load cell feels it, N, positive downwards
    force_n: NDArray[np.float64]
    angle_rad: NDArray[np.float64]  # (n, 3), absolute angles of key, whippen and hammer, rad
    motor_rad: NDArray[np.float64]  # (n,), angle of the motor arm, rad
    # (n,), height of the key's pivot above where it rests, m; None for a plant whose key
    # cannot leave its rail
    key_lift_m: NDArray[np.float64] | None = None


@runtime_checkable
class Plant(Protocol):
    """A piano action with a motor arm, or anything else that answers a motor command."""

    sample_rate_hz: float
    """Rate of the edges; the device sets it to the rate of the sample clock before each ``start_trial``."""

    def start_trial(self, trial: int) -> None:
        """Put the plant at rest for trial ``trial`` (1, 2, …) and draw that trial's scatter from the seed."""

    def advance(self, command_v: NDArray[np.float64]) -> PlantBlock:
        """Apply ``command_v`` (n,), each from edge k to edge k+1, and return the state at the n edges k."""

    def truth(self) -> Any:
        """Return the whole record of the trial, for films and tests; the device never uses it."""
