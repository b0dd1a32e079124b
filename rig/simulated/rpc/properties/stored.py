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
PULSE, BITS = 10265, 10109
PT3750_A = 0.00381
RISING, ENTERING_WINDOW = 10280, 10163
Value = str | bool | int | float
_PARTS: tuple[tuple[str, dict[str, Value]], ...] = (
    ("ANLG_EDGE", {"SRC": "", "SLOPE": RISING, "LVL": 0.0, "HYST": 0.0}),
    ("ANLG_WIN", {"SRC": "", "WHEN": ENTERING_WINDOW, "TOP": 0.0, "BTM": 0.0}),
)
ANALOG_TRIGGERS: dict[str, Value] = {
    f"{shape}_{which}_TRIG_{what}": default
    for which in ("START", "REF")
    for shape, parts in _PARTS
    for what, default in parts.items()
}
"""Settings of analog triggers by name: kept; the trigger itself is what a task cannot run with."""


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
    ("Read", "LOGGING_MODE"): Stored(LOGGING_OFF, harmless=True),
    ("Read", "LOGGING_FILE_PATH"): Stored("", harmless=True),
    ("Read", "LOGGING_FILE_WRITE_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_FILE_PREALLOCATION_SIZE"): Stored(0, harmless=True),
    ("Read", "LOGGING_SAMPS_PER_FILE"): Stored(0),
    ("Read", "LOGGING_TDMS_GROUP_NAME"): Stored("", harmless=True),
    ("Read", "LOGGING_TDMS_OPERATION"): Stored(CREATE, harmless=True),
    ("Read", "LOGGING_PAUSE"): Stored(False),
    ("Write", "OFFSET"): Stored(0),
    ("Write", "RELATIVE_TO"): Stored(CURRENT_WRITE_POSITION),
    ("Write", "SLEEP_TIME"): Stored(0.001, harmless=True),
    ("Write", "WAIT_MODE"): Stored(POLL, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_ENABLE"): Stored(False),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_RATE"): Stored(0.0, harmless=True),
    ("Trig", "DIG_EDGE_START_TRIG_DIG_FLTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Trig", "PAUSE_TRIG_TYPE"): Stored(daqmx.NO_TRIGGER, harmless=True),
    ("Trig", "DIG_LVL_PAUSE_TRIG_SRC"): Stored("", harmless=True),
    ("Trig", "DIG_LVL_PAUSE_TRIG_WHEN"): Stored(daqmx.HIGH, harmless=True),
    ("Trig", "REF_TRIG_PRETRIG_SAMPLES"): Stored(2, harmless=True),
    ("ExportedSignal", "SAMP_CLK_OUTPUT_BEHAVIOR"): Stored(PULSE),
    ("ExportedSignal", "START_TRIG_OUTPUT_TERM"): Stored(""),
    ("ExportedSignal", "SAMP_CLK_OUTPUT_TERM"): Stored(""),
    ("Timing", "ON_DEMAND_SIMULTANEOUS_AO_ENABLE"): Stored(False),
    ("Read", "READ_ALL_AVAIL_SAMP"): Stored(False),
    **{("Trig", name): Stored(default, harmless=True) for name, default in ANALOG_TRIGGERS.items()},
    ("Chan", "AO_RESOLUTION_UNITS"): Stored(BITS),
    ("Chan", "AI_EXCIT_USE_FOR_SCALING"): Stored(False),
    ("Chan", "AI_LOSSY_LSB_REMOVAL_COMPRESSED_SAMP_SIZE"): Stored(16),
    ("Chan", "AI_RTD_A"): Stored(PT3750_A, harmless=True),
    ("Chan", "AI_RTD_R0"): Stored(100.0, harmless=True),
    ("Chan", "AO_USE_ONLY_ON_BRD_MEM"): Stored(False, harmless=True),
    ("Chan", "DI_TRISTATE"): Stored(True, harmless=True),
    ("Chan", "DO_TRISTATE"): Stored(False),
    ("Chan", "CI_CTR_TIMEBASE_SRC"): Stored("", harmless=True),
    ("Chan", "CI_CTR_TIMEBASE_DIG_FLTR_TIMEBASE_SRC"): Stored("100MHzTimebase", harmless=True),
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
