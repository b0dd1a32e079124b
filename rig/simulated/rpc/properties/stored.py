"""Properties that a client may set, ask and reset, and that the virtual device does not act on.

Those that change nothing a client can see are only kept. With any other, a task that is not at its default is refused
when it is committed or started: a setting is never taken and then ignored.
"""

from __future__ import annotations

from dataclasses import dataclass

from rig.simulated import daqmx
from rig.simulated.device.task import SimulatedTask
from rig.simulated.rpc.messages import property_number

CURRENT_READ_POSITION, CURRENT_WRITE_POSITION, LOGGING_OFF, POLL, CREATE = 10425, 10430, 10231, 12524, 15848
Value = str | bool | int | float


@dataclass(frozen=True)
class Stored:
    """Default of a property, and whether a task with another value can run all the same."""

    default: Value
    harmless: bool = False


_STORED: dict[tuple[str, str], Stored] = {
    ("Read", "OFFSET"): Stored(0),
    ("Read", "RELATIVE_TO"): Stored(CURRENT_READ_POSITION),
    ("Read", "SLEEP_TIME"): Stored(0.001, harmless=True),
    ("Read", "WAIT_MODE"): Stored(POLL, harmless=True),
    ("Read", "LOGGING_MODE"): Stored(LOGGING_OFF),
    ("Read", "LOGGING_FILE_PATH"): Stored("", harmless=True),
    ("Read", "LOGGING_FILE_WRITE_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_FILE_PREALLOCATION_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_SAMPS_PER_FILE"): Stored(0, harmless=True),
    ("Read", "LOGGING_TDMS_GROUP_NAME"): Stored("", harmless=True),
    ("Read", "LOGGING_TDMS_OPERATION"): Stored(CREATE, harmless=True),
    ("Read", "LOGGING_PAUSE"): Stored(False, harmless=True),
    ("Write", "OFFSET"): Stored(0),
    ("Write", "RELATIVE_TO"): Stored(CURRENT_WRITE_POSITION),
    ("Write", "SLEEP_TIME"): Stored(0.001, harmless=True),
    ("Write", "WAIT_MODE"): Stored(POLL, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_ENABLE"): Stored(False),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_RATE"): Stored(0.0, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Trig", "PAUSE_TRIG_TYPE"): Stored(daqmx.NO_TRIGGER),
    ("Trig", "DIG_LVL_PAUSE_TRIG_SRC"): Stored("", harmless=True),
    ("Trig", "DIG_LVL_PAUSE_TRIG_WHEN"): Stored(daqmx.HIGH, harmless=True),
    ("Trig", "REF_TRIG_PRETRIG_SAMPLES"): Stored(2, harmless=True),
    ("Chan", "AO_USE_ONLY_ON_BRD_MEM"): Stored(False, harmless=True),
    ("Chan", "DI_TRISTATE"): Stored(True, harmless=True),
    ("Chan", "DO_TRISTATE"): Stored(False),
    ("Chan", "CI_CTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Chan", "CI_CTR_TIMEBASE_DIG_FLTR_TIMEBASE_SRC"): Stored("", harmless=True),
}
STORED = {(category, property_number(category, name)): stored for (category, name), stored in _STORED.items()}
_NAMES = {key: name for name, key in zip(_STORED, STORED, strict=True)}


def accepts(key: tuple[str, int], value: Value) -> bool:
    """Whether a property may be set to a value of this type."""
    return key in STORED and type(value) is type(STORED[key].default)


def note_unsimulated(task: SimulatedTask, key: tuple[str, int], channel: str, value: Value) -> None:
    """Note, or take back, that a task has a setting it cannot run with."""
    what = f"{_NAMES[key][1]} {channel}".strip()
    task.unsimulated.pop(what, None)
    if value != STORED[key].default and not STORED[key].harmless:
        task.unsimulated[what] = str(value)
