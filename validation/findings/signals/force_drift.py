"""Drift of the force: at rest again after the stroke, the load cell does not read what it read before.

Conventions: N; the reading after is the mean over the last 50 ms, in which two encoders must stand where they began.
Detectable from 0.1 N, or five standard uncertainties of the two means. The force is not corrected.
"""

from __future__ import annotations

import numpy as np

from validation.findings.finding import SessionFinding
from validation.findings.signals.encoder_return import at_rest_again, end_of
from validation.measurement.mains_hum import correlation_inflation
from validation.measurement.trial import MeasuredTrial

RETURNS_N = 0.1
SIGMAS = 5.0


def force_drift(m: MeasuredTrial) -> list[SessionFinding]:
    """Force at rest after the stroke against the force at rest before it."""
    last = end_of(m)
    if int(at_rest_again(m).sum()) < 2:
        return []
    reading = m.force.force_n[last]
    u = float(reading.std(ddof=1) * np.sqrt(correlation_inflation(reading) / reading.size))
    u = float(np.hypot(u, m.force.hum.u_offset_n))
    away = float(reading.mean()) - m.force.preload_n
    limit = max(RETURNS_N, SIGMAS * u)
    if abs(away) <= limit:
        return []
    quiet = slice(0, m.quiet.stop)
    before_s, after_s = float(m.time_s[quiet].mean()), float(m.time_s[last].mean())
    slope = float(np.polyfit(m.time_s[quiet], m.raw_force_n[quiet], 1)[0])
    text = (
        f"trial {m.number}: force: at rest after the stroke it reads {away:+.2f} N against before (limit {limit:.2f} "
        f"N), "
        f"{away / (after_s - before_s):+.2f} N/s on average, {slope:+.2f} N/s before the stroke: the zero drifts or "
        f"does "
        "not return; check warm-up, cable and mounting of the load cell"
    )
    return [SessionFinding("force drift", m.number, "force", away, limit, text)]
