"""Log of a bench's motor: command, force at the tip, angle of the arm, and the current where it is recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import UNEVEN

Array = NDArray[np.float64]
LEAST_SAMPLES = 200  # of a log
MODES = ("torque", "voltage")
GAIN = {"torque": "current_gain", "voltage": "voltage_gain"}
COLUMNS = ("time_s", "command_v", "force_n", "arm_rad")


@dataclass(frozen=True, eq=False)
class DriveLog(ArrayRecord):
    """What was recorded, on one clock.

    Attributes
    ----------
    time_s : (n,) equal intervals
    command_v : (n,) command, V, held until the next sample
    force_n : (n,) force of the arm's tip, N, positive where the tip presses
    arm_rad : (n,) angle of the arm, rad, 0 where it is level, positive where the tip goes down
    current_a : (n,) current, A, or None where it was not recorded
    """

    time_s: Array
    command_v: Array
    force_n: Array
    arm_rad: Array
    current_a: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        rows = {k: v for k, v in vars(self).items() if v is not None}
        for name, row in rows.items():
            if np.shape(row) != np.shape(self.time_s) or np.ndim(row) != 1:
                raise InputError(
                    f"log: {name}: found shape {np.shape(row)}, allowed that of time_s, {np.shape(self.time_s)}"
                )
            if not np.all(np.isfinite(row)):
                raise InputError(
                    f"log: {name}: found a value that is not finite in row {int(np.argmin(np.isfinite(row))) + 1}"
                )
        if len(self.time_s) < LEAST_SAMPLES:
            raise InputError(f"log: found {len(self.time_s)} samples, allowed from {LEAST_SAMPLES}")
        steps = np.diff(self.time_s)
        if not np.all(np.abs(steps - self.interval_s) <= UNEVEN * self.interval_s) or not self.interval_s > 0.0:
            raise InputError(
                f"log: time_s: found intervals of {steps.min():g} to {steps.max():g} s, allowed equal ones"
            )
        if np.ptp(self.command_v) == 0.0:
            raise InputError("log: command_v: found the same value throughout, allowed a command that moves the motor")

    @property
    def interval_s(self) -> float:
        """Time between two samples, s."""
        return float((self.time_s[-1] - self.time_s[0]) / (len(self.time_s) - 1))


@dataclass(frozen=True)
class DriveOptions:
    """Values of motor, amplifier and arm that are stated beside a log.

    Attributes
    ----------
    mode : ``torque`` (the command asks for a current) or ``voltage``
    length_m : lever of the tip
    u_length_m : its standard uncertainty
    u_force : relative standard uncertainty of the force's scale
    u_current : relative standard uncertainty of the current's scale
    u_delay_s : standard uncertainty of the time between command and force, and between motion and force
    softness : share of a limit within which it sets in, as ``motor_drive.limit_softness``
    known : numbers of the drive that are known otherwise, by name, with their standard uncertainties: of its data sheet
    """

    mode: str = "torque"
    length_m: float = 0.100  # m: choice; that of the shipped rig
    u_length_m: float = 2.9e-4  # m: read on a rule to 1 mm, rectangular
    u_force: float = 5e-3  # relative: choice, a load cell calibrated with weights
    u_current: float = 5e-3  # relative: choice, a shunt of half a per cent
    u_delay_s: float = 1e-5  # s: choice, a tenth of a sample at 10 kHz
    softness: float = 0.05  # as `motor_drive.limit_softness`
    known: dict[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InputError(f"mode of the drive: found {self.mode!r}, allowed {' or '.join(MODES)}")
        if not 0.0 < self.length_m <= 2.0:
            raise InputError(f"length of the arm: found {self.length_m:g} m, allowed above 0 to 2")
        for name in ("u_length_m", "u_force", "u_current", "u_delay_s"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise InputError(f"{name}: found {getattr(self, name):g}, allowed from 0")
        allowed = ["resistance", "inductance", "torque_constant", GAIN[self.mode], "supply", "current_limit"]
        allowed += ["loop_gain"] if self.mode == "torque" else []
        for name, (value, u) in self.known.items():
            if name not in allowed:
                raise InputError(f"known of the drive: found {name!r}, allowed {', '.join(allowed)}")
            if not (math.isfinite(value) and value > 0.0 and math.isfinite(u) and u > 0.0):
                raise InputError(f"known of the drive: {name}: found {value:g} with u {u:g}, allowed both above 0")


def read_drive_log(path: str | Path) -> DriveLog:
    """Read a log from a CSV file: ``time_s``, ``command_v`` and ``arm_rad`` rising as the tip goes down, ``force_n``
    above 0 where it presses, ``current_a`` where it was recorded; other columns are left out.

    Parameters
    ----------
    path : CSV file; further columns are left alone

    Returns
    -------
    DriveLog

    Raises
    ------
    InputError : the file cannot be read or used; the message names file, column and row

    Examples
    --------
    >>> from pathlib import Path
    >>> import model
    >>> rows = [f"{k / 5000},{0.01 * (k // 50)},0.0,0.0" for k in range(300)]
    >>> text = "time_s,command_v,force_n,arm_rad\\n" + "\\n".join(rows)
    >>> _ = Path("drive_log.csv").write_text(text)
    >>> model.drive.read_drive_log("drive_log.csv").current_a is None
    True
    """
    table = read_columns(path, COLUMNS, None)
    current = table.numbers("current_a") if "current_a" in table.names else None
    try:
        time_s, command_v, force_n, arm_rad = (table.numbers(name) for name in COLUMNS)
        return DriveLog(time_s, command_v, force_n, arm_rad, current)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
