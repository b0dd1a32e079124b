"""Tables of trials: what was done with each before it was compared, and the stated uncertainty of its channels.

Place in the data flow: `validation.measurement.trial` → here → `validation.pipeline.compare_session`.
Conventions: SI and rad.
Failure: a trial that is not used has only its reason.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from validation.measurement.trial import ENCODER_CHANNELS, FILM_CHANNELS, Measurement
from validation.prediction.trial_prediction import Prediction


def uncertainty_table(measurements: list[Measurement], film: dict[int, pd.DataFrame]) -> pd.DataFrame:
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


def trial_row(number: int, m: Measurement | None, reason: str, p: Prediction | None) -> dict[str, object]:
    """One row of the trial table; a trial that is not used has only its reason."""
    if m is None or p is None:
        return {"trial": number, "used": False, "reason": reason}
    hum = m.force.hum
    row: dict[str, object] = {
        "trial": number,
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
        "u_preload_n": m.force.u_preload_n,
        "group_delay_s": m.force.group_delay_s,
        "peak_force_n": float(m.force.force_n.max()),
        "filmed": m.film is not None,
        "reused": p.reused,
        "seal": m.seal,
        "notes": "; ".join(m.notes),
    }
