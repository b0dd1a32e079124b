"""Readings that no body and no load cell makes: leaps, standstills, and records that do not begin at rest."""

from __future__ import annotations

import numpy as np

from validation.events.crossings import find_equal_runs
from validation.events.detect import LONG_S
from validation.events.encoder_readings import (
    NOISE_SIGMAS,
    are_simultaneous,
    find_reading_faults,
    measure_step_excess,
)
from validation.findings.finding import BLOW, CURVES, SessionFinding, register_kinds
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles


@register_kinds({"gap": "Record again: all channels leap at one sample, as where samples are lost."}, spoils=BLOW)
@register_kinds(
    {
        "reading leaps": "Check cable, signal level and largest count rate of the encoder whose reading leaps.",
        "reading stands still": "Check cable and counter or converter of the channel whose reading stands still.",
    },
    spoils=CURVES,
)
def find_encoder_faults(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """One finding for each encoder whose reading leaps between two samples (value: the leap, rad) or stands still while
    its body moves (value: how long, s); instead one gap for the whole trial where several leap at the same sample."""
    faults = find_reading_faults(m, p)
    if are_simultaneous(faults, m.time_s):
        names = " and ".join(fault.channel for fault in faults)
        text = (
            f"trial {m.number}: encoders {names} leap at the same sample, {faults[0].at_s:.4f} s, by "
            f"{', '.join(f'{1e3 * fault.leap_rad:+.2f}' for fault in faults)} mrad"
        )
        return [SessionFinding("gap", m.number, "", faults[0].leap_rad, faults[0].limit_rad, text)]
    out = []
    for fault in faults:
        where = f"trial {m.number}: encoder {fault.channel}:"
        limit = f"limit {1e3 * fault.limit_rad:.2f} mrad"
        leap = f"{1e3 * fault.leap_rad:+.2f} mrad"
        if fault.still_s:
            text = f"{where} its count does not change for {1e3 * fault.still_s:.1f} ms from {fault.at_s:.4f} s"
            text += f", after {1e3 * fault.stop_rad:+.2f} mrad in the last sample before" if fault.stop_rad else ""
            text += f", then leaps by {leap} from one sample to the next" if fault.leap_rad else ""
            if not (fault.leap_rad or fault.stop_rad):
                text += ", and it moves at once before or after; its body moves in the model meanwhile"
            text += f" ({limit})"
            out.append(SessionFinding("reading stands still", m.number, fault.channel, fault.still_s, 0.0, text))
            continue
        text = f"{where} leaps by {leap} from one sample to the next at {fault.at_s:.4f} s ({limit})"
        text += f" and back {1e3 * (fault.until_s - fault.at_s):.1f} ms later" if np.isfinite(fault.until_s) else ""
        text += "; no other encoder leaps there" if fault.is_alone else "; another encoder leaps there as well"
        out.append(SessionFinding("reading leaps", m.number, fault.channel, fault.leap_rad, fault.limit_rad, text))
    return out


FEWEST_EQUAL = 5  # by chance 20^-4 of a reading
COARSE = 0.05  # of the neighbours at rest: a converter that coarse repeats its reading of itself


def is_followed_by_jump(m: MeasuredTrial, last: int) -> bool:
    """Whether the force jumps from this sample to the next: outside of the steps before and after, and of its noise."""
    steps = np.diff(m.raw_force_n[: m.quiet.stop])
    jump, _ = measure_step_excess(m.raw_force_n, m.time_s, 0.0, m.quiet.stop)
    return last < jump.size and abs(float(jump[last])) > NOISE_SIGMAS * float(steps.std())


def find_force_standstill(m: MeasuredTrial) -> list[SessionFinding]:
    """One finding of five or more equal raw force readings in a row, inside the range and the record; empty if none, or
    where the channel has no noise. The value is the length of the longest such run, samples.

    Conventions: raw readings. Five equal readings in a row have no chance where fewer than one in twenty pairs of
    neighbours at rest are equal. Readings at either end of the range are a saturation's, unless the force jumps from
    there; those at either end of the record may be filled up.
    """
    force = m.raw_force_n
    steps = np.diff(force[: m.quiet.stop])
    if steps.size < 2 or not steps.std() > 0 or float(np.mean(steps == 0)) >= COARSE:
        return []
    starts, ends = find_equal_runs(force)
    length = ends - starts + 1
    inside = (force[starts] < force.max()) & (force[starts] > force.min())
    inside |= np.array(
        [n >= FEWEST_EQUAL and is_followed_by_jump(m, int(last)) for n, last in zip(length, ends, strict=True)]
    )
    length = np.where(inside & (starts > 0) & (ends < force.size - 1), length, 0)
    longest = int(length.argmax())
    if length[longest] < FEWEST_EQUAL:
        return []
    n, start_s, end_s = int(length[longest]), float(m.time_s[starts[longest]]), float(m.time_s[ends[longest]])
    text = (
        f"trial {m.number}: force: {n} readings in a row are {force[starts[longest]]:.3f} N, from {start_s:.4f} to "
        f"{end_s:.4f} s (limit {FEWEST_EQUAL}), though the channel's noise at rest is "
        f"{float(steps.std() / np.sqrt(2)):.3f} N"
    )
    return [SessionFinding("reading stands still", m.number, "force", float(n), float(FEWEST_EQUAL), text)]


NO_REST = "no rest at the start"
RISES_M, FALLS_N = 1e-3, 0.5  # of key front and force: choice, a tenth of the dip, the down weight


@register_kinds({NO_REST: "Start the record before the stroke, with the key at rest, and record again."},
       spoils=BLOW)  # fmt: skip
def find_missing_rest(m: MeasuredTrial, geometry: ActionGeometry) -> list[SessionFinding]:
    """One finding where a record does not begin at rest: it ends with the key front 1 mm or more higher and the force
    0.5 N or more lower than it began; else an empty list. The value is that rise of the key front, m.

    Conventions: the last 50 ms against the first samples; from 1 mm of key dip and 0.5 N, both.
    """
    last = m.time_s >= m.time_s[-1] - LONG_S
    dip = geometry.key_dip_m(geometry.absolute({0: m.change_rad[:, 0]}))
    rise, fall = -float(dip[last].mean()), m.force.preload_n - float(m.force.force_n[last].mean())
    if rise < RISES_M or fall < FALLS_N:
        return []
    text = (
        f"trial {m.number}: the record does not begin at rest: at its end the key front is {1e3 * rise:.1f} mm higher "
        f"(limit {1e3 * RISES_M:g} mm) and the force {fall:.2f} N lower (limit {FALLS_N:g} N) than at its start; "
        "nothing else is said of this trial"
    )
    return [SessionFinding(NO_REST, m.number, "", rise, RISES_M, text)]
