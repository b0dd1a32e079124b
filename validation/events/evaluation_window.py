"""The evaluation window: one interval for all trials and channels, fixed from measured events before any scoring.

Padding a window with quiet samples improves any average; hence one printed rule, not a choice after the fact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.events.definitions import Event
from validation.measurement.trial import MeasuredTrial

LEAD_S = 0.02
TAIL_S = 0.05


@dataclass(frozen=True)
class Window:
    """Start and end in s, and the rule each came from."""

    start_s: float
    end_s: float
    start_rule: str
    end_rule: str

    def mask(self, time_s: Array) -> NDArray[np.bool_]:
        """Samples inside the window."""
        time = np.asarray(time_s, dtype=float)
        return (time >= self.start_s) & (time <= self.end_s)


def common_window(measurements: Sequence[MeasuredTrial], events: dict[int, dict[str, Event]]) -> Window:
    """From 20 ms before the earliest force onset to 50 ms after the last trial is at rest, within every record.

    Parameters
    ----------
    measurements : sequence of MeasuredTrial
    events : dict
        Trial number → measured events.

    Raises
    ------
    ValidationInputError
        The records have no time in common.
    """
    start = max(min(m.quiet.onset_s for m in measurements) - LEAD_S, max(float(m.time_s[0]) for m in measurements))
    # the model knows no force for the last group delay of a record
    record = min(float(m.force.time_s[-1]) for m in measurements)
    rests = [events[m.number]["rest"] for m in measurements]
    if all(rest.status != "absent" for rest in rests):
        end, rule = max(rest.value for rest in rests) + TAIL_S, "50 ms after the last trial came to rest"
    else:
        end, rule = record, "end of the shortest record, because a trial does not come to rest"
    if end > record:
        end, rule = record, "end of the shortest record"
    if not end > start:
        raise ValidationInputError(
            f"evaluation window: start {start:.4f} s, end {end:.4f} s; the trials do not overlap in time"
        )
    return Window(start, end, "20 ms before the earliest force onset", rule)
