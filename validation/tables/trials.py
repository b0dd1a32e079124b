"""Tables of trials: what was done with each before it was compared, what was left out, the stated uncertainties.

Conventions: SI and rad. A trial that is not used has only its reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np
import pandas as pd

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS
from validation.events.key_lift import KeyLift
from validation.measurement.trial import MeasuredTrial
from validation.prediction.session import PredictedSession

LIFT_COLUMNS = ["trial", "channel", "start_s", "end_s", "largest_at_s", "gap_m", "lift_m", "rail_pull_n", "reason"]


def lift_table(lifts: Mapping[int, Sequence[KeyLift]]) -> pd.DataFrame:
    """Every interval left out of the scores."""
    rows = [{"trial": number, "channel": "key", **asdict(lift)} for number, found in lifts.items() for lift in found]
    return pd.DataFrame(rows, columns=LIFT_COLUMNS)


def uncertainty_table(measurements: Sequence[MeasuredTrial], film: dict[int, pd.DataFrame]) -> pd.DataFrame:
    """Stated standard uncertainty of one sample of every channel; for film the median over frames."""
    rows: list[dict[str, object]] = []
    for m in measurements:
        for i, name in enumerate(ENCODER_CHANNELS):
            quantisation = float(m.resolution_rad[i] / np.sqrt(12))
            rows.append(
                {
                    "trial": m.number,
                    "channel": name,
                    "source": "encoder",
                    "quantisation_rad": quantisation,
                    "u_rad": float(m.u_rad[i]),
                    "scale_relative_u": float(m.scale_relative_u[i]),
                }
            )
        if m.number in film:
            for name in FILM_CHANNELS:
                u = film[m.number][f"{name}_u_rad"].to_numpy()
                u = u[np.isfinite(u)]
                median = float(np.median(u)) if u.size else float("nan")
                rows.append(
                    {
                        "trial": m.number,
                        "channel": name,
                        "source": "film",
                        "quantisation_rad": np.nan,
                        "u_rad": median,
                        "scale_relative_u": np.nan,
                    }
                )
    return pd.DataFrame(rows)


def trial_table(predicted: PredictedSession) -> pd.DataFrame:
    """Every trial of the session, used or not."""
    measured = {m.number: m for m in predicted.trials}
    rows = []
    for number in sorted({*measured, *predicted.refused}):
        if number in measured:
            rows.append(_used(measured[number], predicted.predictions[number].model.reused))
        else:
            rows.append({"trial": number, "used": False, "reason": predicted.refused[number]})
    return pd.DataFrame(rows)


def _used(m: MeasuredTrial, reused: bool) -> dict[str, object]:
    hum = m.force.hum
    row: dict[str, object] = {
        "trial": m.number,
        "used": True,
        "reason": "",
        "quiet_s": m.quiet.length_s,
        "onset_s": m.quiet.onset_s,
        "offset_n": hum.offset_n,
        "u_offset_n": hum.u_offset_n,
        "hum_hz": hum.frequency_hz,
        "hum_searched": hum.frequency_searched,
        "hum_accepted": hum.accepted,
        "hum_reason": hum.reason,
    }
    row |= {f"hum_{k}_n": a for k, a in enumerate(hum.amplitude_n, start=1)}
    row |= {f"hum_{k}_phase_rad": a for k, a in enumerate(hum.phase_rad, start=1)}
    return row | {
        "noise_n": m.force.noise_n,
        "preload_n": m.force.preload_n,
        "u_preload_n": m.force.channel.u_preload_n,
        "group_delay_s": m.force.channel.group_delay_s,
        "peak_force_n": float(m.force.force_n.max()),
        "filmed": m.film is not None,
        "reused": reused,
        "seal": m.seal,
        "notes": "; ".join(m.notes),
    }
