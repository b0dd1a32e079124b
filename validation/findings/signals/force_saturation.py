"""Saturation of the force: readings that stay at their largest value without the channel's own noise.

Conventions: raw readings, N. A plateau is three equal readings in a row at the largest or smallest value, or five
within a fifth of the channel's noise. Not judged are a channel without noise and, for equal readings, one whose
converter is so coarse that more than a twentieth of the neighbours at rest are equal. Detectable from three readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial

FLAT = 0.2  # of the noise
FEWEST_FLAT, FEWEST_EQUAL = 5, 3
COARSE = 0.05


def force_saturation(m: MeasuredTrial) -> list[SessionFinding]:
    """A plateau at the largest or the smallest reading."""
    force = m.raw_force_n
    steps = np.diff(force[: m.quiet.stop])
    noise = float(np.std(steps, ddof=1) / np.sqrt(2))
    if not noise > 0:
        return []
    fine = float(np.mean(steps == 0)) < COARSE
    for sign, words in ((1.0, "largest"), (-1.0, "smallest")):
        most = float((sign * force).max())
        start, length = _longest_run(sign * force > most - FLAT * noise)
        fewest = FEWEST_FLAT
        if length < fewest and fine:
            start, length = _longest_run(sign * force == most)
            fewest = FEWEST_EQUAL
        if length < fewest:
            continue
        text = (
            f"trial {m.number}: force: {length} readings in a row stay at the {words} value {sign * most:.2f} N from "
            f"{m.time_s[start]:.4f} s, without the channel's noise of {noise:.3f} N: the channel saturates; widen its "
            "range"
        )
        return [SessionFinding("force saturation", m.number, "force", float(length), float(fewest), text)]
    return []


def _longest_run(flat: NDArray[np.bool_]) -> tuple[int, int]:
    """Start and length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat.astype(np.int8), [0]])))
    if not edges.size:
        return 0, 0
    runs = edges[1::2] - edges[::2]
    longest = int(runs.argmax())
    return int(edges[::2][longest]), int(runs[longest])
