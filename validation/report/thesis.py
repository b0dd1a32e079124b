"""Which figure of the thesis a figure of the report repeats, for a reader who lays them side by side.

For a blow that the thesis does not have, the figure is said to be drawn like the forte's.
Source: M. Hirschkorn (2004), Figures 3.9–3.13 (forte) and 4.1–4.15 (forte, piano, double; 4.9–4.11: piano with the
damping calibrated anew beside the first calibration).
"""

from __future__ import annotations

import re

CONDITIONS = ("forte", "piano", "double")
MEASURED = {"force": "3.9", "key": "3.10", "whippen": "3.11", "hammer": "3.12", "film": "3.13"}
COMPARED = {
    "forte": {"force": "4.1", "key": "4.2", "whippen": "4.3", "hammer": "4.4"},
    "piano": {"force": "4.5", "key": "4.6", "whippen": "4.7", "hammer": "4.8"},
    "double": {"force": "4.12", "key": "4.13", "whippen": "4.14", "hammer": "4.15"},
}
RECALIBRATED = {"key": "4.9", "whippen": "4.10", "hammer": "4.11"}


def condition_of(session_name: str, profile: str) -> str:
    """The one of forte, piano and double that is named by the session or else by its profile; else an empty text."""
    for text in (session_name, profile):
        named = set(re.findall(r"[a-z]+", text.lower())) & set(CONDITIONS)
        if len(named) == 1:
            return named.pop()
    return ""


def measured_anchor(condition: str, kind: str) -> str:
    """The thesis's figure of repeated trials; it has them for the forte only."""
    return f"{'As' if condition == 'forte' else 'Drawn like'} thesis Fig. {MEASURED[kind]}."


def compared_anchor(condition: str, kind: str, n_models: int) -> str:
    """The thesis's figure of model against experiment, with two models also that of the damping calibrated anew."""
    if condition not in COMPARED:
        return f"Drawn like thesis Fig. {COMPARED['forte'][kind]}."
    number = COMPARED[condition][kind]
    if condition == "piano" and n_models > 1 and kind in RECALIBRATED:
        return f"As thesis Figs {number} and {RECALIBRATED[kind]}."
    return f"As thesis Fig. {number}."
