"""Table *trials*: what was done with each trial before it was compared."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from validation.measurement.trial import MeasuredTrial
from validation.numbers import DASH, number
from validation.tables.comparison import Comparison
from validation.tables.table import TRIAL, Column, Page, Row, Table


def _state(row: Row) -> str:
    if not row["used"]:
        return f"not used: {row['reason']}"
    outside = f", outside: {row['why_outside']}" if row["outside"] is True else ""
    return "used" + (", filmed" if row["filmed"] else "") + outside


def _hum(row: Row) -> str:
    if not isinstance(row["hum_accepted"], bool):  # not used, or no force was recorded
        return DASH
    return f"{number(row['hum_1_n'], 3)} N at {row['hum_hz']:.2f} Hz" if row["hum_accepted"] else "none subtracted"


COLUMNS = (
    TRIAL,
    Column("used", "", "Whether the trial was compared", bool, head="state", text=_state),
    Column("reason", "", "Why it was not used; empty when it was", str),
    Column("quiet_s", "s", "Length of the quiet stretch before the blow", head="quiet", shown=("ms", 1e3)),
    Column("onset_s", "s", "Onset of the force"),
    Column("offset_n", "N", "Offset of the force, subtracted", head="offset", u="u_offset_n"),
    Column("u_offset_n", "N", "Its standard uncertainty"),
    Column("hum_hz", "Hz", "Fitted mains frequency"),
    Column("hum_searched", "", "Whether the frequency was searched (true) or taken as declared", bool, optional=True),
    Column("hum_accepted", "", "Whether the fitted hum was subtracted", bool, optional=True),
    Column("hum_reason", "", "Why the fit was refused; empty when it was not", str, optional=True),
    Column("hum_1_n", "N", "Amplitude of the fitted hum at 1 times the mains frequency", head="mains hum", text=_hum),
    Column("hum_2_n", "N", "Amplitude of the fitted hum at 2 times the mains frequency"),
    Column("hum_3_n", "N", "Amplitude of the fitted hum at 3 times the mains frequency"),
    Column("hum_1_phase_rad", "rad", "Phase of the fitted hum at 1 times the mains frequency"),
    Column("hum_2_phase_rad", "rad", "Phase of the fitted hum at 2 times the mains frequency"),
    Column("hum_3_phase_rad", "rad", "Phase of the fitted hum at 3 times the mains frequency"),
    Column("noise_n", "N", "Standard deviation of the force in the quiet stretch after correction", head="noise",
           shown=("mN", 1e3)),
    Column("preload_n", "N", "Declared force on the key at rest"),
    Column("u_preload_n", "N", "Its standard uncertainty"),
    Column("group_delay_s", "s", "Delay of the force channel, taken off its times", head="delay"),
    Column("peak_force_n", "N", "Largest corrected force", head="peak force"),
    Column("filmed", "", "Whether tracked film angles were there", bool, optional=True),
    Column("reused", "", "Whether the kept prediction was used, not simulated again", bool, optional=True),
    Column("seal", "", "SHA-256 of the recorded trial", str, optional=True),
    Column("notes", "", "Notes on the trial, separated by semicolons", str, optional=True),
    Column("fitted", "", "Whether the action was fitted to it (by hash); null for one that is not used", bool,
           optional=True),
    Column("distance", "widenings", "How far it lies from what was fitted, 1 is the limit; null where it is not known, "
           "or a phase was never fitted"),
    Column("outside", "", "Whether it lies outside of what was fitted; null where it is not known", bool,
           optional=True),
    Column("why_outside", "", "What sets it outside", str, optional=True),
)  # fmt: skip


def rows(comparison: Comparison) -> pd.DataFrame:
    """Every trial of the session, used or not; with how far it lies from the strokes that a model was fitted to."""
    table = pd.DataFrame(list(_rows(comparison)))
    places = table[["trial"]].merge(comparison.rivals.places, on="trial", how="left").drop(columns="trial")
    places["outside"] = places["outside"].astype(object).where(places["outside"].notna(), None)
    names = [column.name for column in COLUMNS if column.name not in places]
    return pd.concat([table.reindex(columns=names), places.fillna({"why_outside": ""})], axis=1)


def _rows(comparison: Comparison) -> Iterator[dict[str, object]]:
    """Yield rows by column of all trials in order of their number: of those used what was measured, of the others
    number and reason."""
    predicted = comparison.predicted
    measured = {m.number: m for m in predicted.trials}
    for n in sorted({*measured, *predicted.refused}):
        if n in measured:
            yield _make_used_row(measured[n], predicted.predictions[n].model.reused)
        else:
            yield {"trial": n, "used": False, "reason": predicted.refused[n]}


def _make_used_row(m: MeasuredTrial, reused: bool) -> dict[str, object]:
    """Row by column of a used trial, without force cells where no force was recorded; ``reused``: whether its
    prediction came from the store."""
    row = {
        "trial": m.number,
        "used": True,
        "reason": "",
        "quiet_s": m.quiet.length_s,
        "onset_s": m.quiet.onset_s,
        "filmed": m.film is not None,
        "reused": reused,
        "seal": m.seal,
        "notes": "; ".join(m.notes),
    }
    return row | (_force_cells(m) if m.has_force else {})


def _force_cells(m: MeasuredTrial) -> dict[str, object]:
    """Cells of a trial's row on its force: offset, hum, noise, preload, delay and peak."""
    hum = m.force.hum
    row: dict[str, object] = {
        "offset_n": hum.offset_n,
        "u_offset_n": hum.u_offset_n,
        "hum_hz": hum.frequency_hz,
        "hum_searched": hum.frequency_searched,
        "hum_accepted": hum.accepted,
        "hum_reason": hum.reason,
        "noise_n": m.force.noise_n,
        "preload_n": m.force.preload_n,
        "u_preload_n": m.force.channel.u_preload_n,
        "group_delay_s": m.force.channel.group_delay_s,
        "peak_force_n": float(m.force.force_n.max()),
    }
    row |= {f"hum_{k}_n": a for k, a in enumerate(hum.amplitude_n, start=1)}
    return row | {f"hum_{k}_phase_rad": a for k, a in enumerate(hum.phase_rad, start=1)}


TABLE = Table(
    "trials",
    "trial: what was done with it before it was compared",
    COLUMNS,
    rows,
    (Page("trials", "Trials and the correction of their force", order=1),),
    of_model=False,
)
