"""Tables of events: every event of every trial and prediction, and their paired comparison.

Conventions: SI; differences are model − trial, paired by trial; presence is judged before timing. An event that did not
happen is NaN and its ``status`` says so.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.events.definitions import EVENTS, Event
from validation.statistics.area_metric import area_floor, area_metric


def event_table(trial: dict[int, dict[str, Event]], model: dict[int, dict[str, Event]]) -> pd.DataFrame:
    """Every event of every trial and of its prediction."""
    rows = [
        {
            "trial": number,
            "source": source,
            "event": e.name,
            "value": e.value,
            "u": e.u,
            "unit": EVENTS[e.name].unit,
            "status": e.status,
            "note": e.note,
        }
        for source, events in (("trial", trial), ("model", model))
        for number, found in events.items()
        for e in found.values()
    ]
    return pd.DataFrame(rows)


def event_summary(trial: dict[int, dict[str, Event]], model: dict[int, dict[str, Event]]) -> pd.DataFrame:
    """Presence first, then means and paired differences (model − trial) where both found the event.

    An event that a trial leaves out does not count in it.
    """
    rows = []
    for name, kind in EVENTS.items():
        t = [events[name] for events in trial.values() if name in events]
        m = [model[number][name] for number, events in trial.items() if name in events]
        there = np.array([e.status != "absent" for e in t], dtype=bool)  # no trial may count
        predicted = np.array([e.status != "absent" for e in m], dtype=bool)
        both = there & predicted
        tv, mv = np.array([e.value for e in t]), np.array([e.value for e in m])
        tu, mu = np.array([e.u for e in t]), np.array([e.u for e in m])
        d = (mv - tv)[both]
        n = d.size
        s = float(d.std(ddof=1)) if n > 1 else float("nan")
        # the levels of rest are the same for all trials, so averaging does not shrink the stated uncertainty
        stated = float(np.sqrt(np.mean(tu[both] ** 2 + mu[both] ** 2))) if n else float("nan")
        floor, floor_95 = area_floor(int(predicted.sum()), int(there.sum()))
        spread = float(tv[there].std(ddof=1)) if there.sum() > 1 else float("nan")
        rows.append(
            {
                "event": name,
                "unit": kind.unit,
                "n_trials": len(t),
                "found_trial": int(there.sum()),
                "found_model": int(predicted.sum()),
                "agree": bool(np.all(there == predicted)),
                "ambiguous": sum(e.status == "ambiguous" for e in t + m),
                "trial_mean": float(tv[there].mean()) if there.any() else float("nan"),
                "trial_s": spread,
                "model_mean": float(mv[predicted].mean()) if predicted.any() else float("nan"),
                "difference": float(d.mean()) if n else float("nan"),
                "difference_s": s,
                "u_difference": float(np.hypot(stated, s / np.sqrt(n))) if n > 1 else stated,
                "n_both": n,
                "u_trial": float(np.sqrt(np.mean(tu[both] ** 2))) if n else float("nan"),
                "area": area_metric(mv[predicted], tv[there]),
                "area_floor": floor * spread,
                "area_floor_95": floor_95 * spread,
            }
        )
    return pd.DataFrame(rows)
