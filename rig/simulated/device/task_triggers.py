"""The triggers of a task of the virtual device: which it has, and from where; the timing knows when they come."""

from __future__ import annotations

from dataclasses import dataclass, field

from rig.simulated.device.comparator import AnalogShape


@dataclass(eq=False)
class Triggers:
    """Terminals of the triggers, relative to the device; "" for none."""

    start: str = ""
    arm_start: str = ""
    reference: str = ""
    pretrigger_samples: int = 0
    """Samples to keep from before the reference trigger."""
    analog_kinds: dict[str, str] = field(default_factory=dict)
    """What a client has set of analog triggers: kind of shape by start trigger or reference trigger."""
    analog_start: AnalogShape | None = None
    analog_reference: AnalogShape | None = None
    pause: str = ""
    pause_high: bool = True
    """Sampling pauses while this terminal is high, or low."""

    def forget(self, which: str) -> None:
        """Take the start trigger or reference trigger away, of whatever kind."""
        self.analog_kinds.pop(which, None)
        if which == "start trigger":
            self.start = ""
        else:
            self.reference = ""

    @property
    def begin(self) -> str:
        """Terminal of the trigger with which sampling begins: start trigger, or arm start trigger of a counter."""
        return self.start or self.arm_start

    @property
    def awaited(self) -> bool:
        """Whether sampling begins with a trigger."""
        return bool(self.begin or self.analog_start)

    @property
    def referenced(self) -> bool:
        """Whether samples from before a trigger are kept."""
        return bool(self.reference or self.analog_reference)
