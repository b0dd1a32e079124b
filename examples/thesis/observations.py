"""The sensitivity studies of the thesis (Figs 4.9-4.11, 4.16-4.19) repeated, each of its 22 observations a check.

The thesis's statements are qualitative: every check names the number it judges by and its limit. Nearly identical is
5 % of the range, slightly up to 5 mm or 20 %, minor 10 %, large from 10 %, almost no effect on the strike 1 ms and 2 %;
held is within 1 mm in the last 0.1 s with the back check in contact. "Range" is the widest turn of that body in the
action as given. The measured forces are not printed, so the blows follow their description; the set as printed is not
regulated. So an observation that does not hold is no refutation. What the thesis compares with its experiment is left
out.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import model
from model.study import FORTE_VARIANTS, PIANO_VARIANTS, Study

Array = NDArray[np.float64]

(INCREASED,) = (variant.name for variant in PIANO_VARIANTS)
DECREASED, UNDAMPED, UNDAMPED_BUT_STRING, SLIPPERY, SLIPPERY_CHECK, LOOSE = (v.name for v in FORTE_VARIANTS)
AS_GIVEN = "as given"


class Observation(NamedTuple):
    """A statement of the thesis: its figure or section, the number that decides, its limit, and whether it holds."""

    figure: str
    statement: str
    judged_by: str
    found: float
    unit: str
    allowed: str
    holds: bool


def largest_share(study: Study, name: str, body: str, start: float = -math.inf, end: float = math.inf) -> float:
    """Largest difference from the action as given, % of the body's range; NaN where there is no such time."""
    away = study.difference(name, body, start, end)
    return 100.0 * float(np.max(np.abs(away))) / study.range(body) if len(away) else math.nan


def rms_share(study: Study, name: str, start: float = -math.inf) -> float:
    """Root mean square difference of the hammer, % of its range."""
    return 100.0 * float(np.sqrt(np.mean(study.difference(name, "hammer", start) ** 2))) / study.range("hammer")


def check(
    figure: str, statement: str, judged_by: str, found: float, unit: str, allowed: str, holds: bool | None = None
) -> Observation:
    """An observation; it holds where ``found`` is within ``allowed`` ("to 5", "from 10"), if nothing else is said."""
    if holds is None:
        side, limit = allowed.split()
        holds = bool(found <= float(limit) if side == "to" else found >= float(limit))
    return Observation(figure, statement, judged_by, found, unit, allowed, holds)


def check_piano(study: Study) -> list[Observation]:
    """Figs 4.9 to 4.11: damping for soft blows."""
    later = study[INCREASED][1].strike_s - study[AS_GIVEN][1].strike_s
    bodies = (("4.9", "key"), ("4.10", "whippen"), ("4.11", "hammer"))
    out = [
        check(figure, f"piano: damping for soft blows leaves the {body}'s motion nearly identical",
              "largest difference, % of range", largest_share(study, INCREASED, body), "%", "to 5")
        for figure, body in bodies
    ]  # fmt: skip
    statement = "piano: it does not take away the delay before the strike"
    return [*out, check("4.11", statement, "strike later by", 1e3 * later, "ms", "to 1")]


def check_not_held(figure: str, statement: str, study: Study, name: str) -> Observation:
    """Whether the back check does not hold the hammer."""
    m = study[name][1]
    judged_by = f"hammer moves in the last 0.1 s of the hold, {'held by' if m.held else 'not held by'} the check"
    return check(figure, statement, judged_by, 1e3 * m.hold_moved_m, "mm", "above 1, or off the check", not m.held)


def check_forte(study: Study) -> list[Observation]:
    """Figs 4.16 to 4.19: less damping, none, no friction."""
    given, changed = study[AS_GIVEN][1], study[DECREASED][1]
    lower, strike = 1e3 * (changed.hold_m - given.hold_m), given.strike_s
    before = largest_share(study, DECREASED, "hammer", strike + 0.1, given.release_s)
    after = largest_share(study, DECREASED, "hammer", given.release_s)
    out = [
        check("4.16", "a tenth of the damping: the hammer checks slightly lower", "hold lower by",
              lower, "mm", "0 to 5", bool(given.held and changed.held and 0.0 < lower <= 5.0)),
        check("4.16", "it diverges slightly after the key is released",
              f"largest difference after release, % of range (before: {before:.1f})",
              after, "%", "more than before, to 20", bool(before < after <= 20.0)),
        check("4.16", "the behaviour as a whole stays close", "RMS difference, % of range",
              rms_share(study, DECREASED), "%", "to 5"),
    ]  # fmt: skip
    for name in (UNDAMPED, UNDAMPED_BUT_STRING):
        out += [
            check("4.17", f"{name}: a large effect", "RMS difference, % of range", rms_share(study, name), "%",
                  "from 10"),
            check_not_held("4.17", f"{name}: the hammer is not held on the back check", study, name),
            check("4.17", f"{name}: it keeps bouncing on the repetition lever",
                  "touches of knuckle and lever between strike and release",
                  study[name][1].lever_bounces, "", "from 3"),
        ]  # fmt: skip
    return [
        *out,
        check_not_held("4.18", f"{SLIPPERY}: the hammer fails to check", study, SLIPPERY),
        check_not_held("4.18", "friction at the back check alone decides that", study, SLIPPERY_CHECK),
        check("4.19", f"{LOOSE}: no deviation between check and 0.50 s",
              "largest difference from 0.1 s after the strike to 0.50 s, % of range",
              largest_share(study, LOOSE, "hammer", strike + 0.1, 0.5), "%", "to 2"),
        check("4.19", f"{LOOSE}: a minor deviation after 0.50 s", "largest difference after 0.50 s, % of range",
              largest_share(study, LOOSE, "hammer", 0.5), "%", "to 10"),
    ]  # fmt: skip


def check_strike(study: Study, lost: float, lost_elsewhere: float) -> list[Observation]:
    """Section 4.4: what the changes do to the strike; energy lost before it, in all and off the key front, %."""
    given = study[AS_GIVEN][1]
    others = {v.name: m for v, m in zip(study.variants[1:], study.measures[1:], strict=True)}

    def farthest(measure: str) -> tuple[str, float]:
        """The variant that changes it most, and its value; one that never strikes is infinitely far."""
        away = {name: abs(getattr(m, measure) - getattr(given, measure)) for name, m in others.items()}
        name = max(away, key=lambda n: away[n] if np.isfinite(away[n]) else math.inf)
        return name, getattr(others[name], measure)

    (late, strike_s), (fast, speed) = farthest("strike_s"), farthest("strike_m_per_s")
    after = {name: rms_share(study, name, given.strike_s) for name in others}
    most = max(after, key=lambda name: after[name])
    return [
        check("4.4", "none of the changes touches the initial strike: its time", f"largest change ({late})",
              1e3 * abs(strike_s - given.strike_s), "ms", "to 1"),
        check("4.4", "none of the changes touches the initial strike: its speed", f"largest change ({fast})",
              100.0 * abs(speed / given.strike_m_per_s - 1.0), "%", "to 2"),
        check("4.4", "friction and damping lose no significant energy before the strike",
              "lost by then, % of the work put in", lost, "%", "to 5"),
        check("4.4", "the same, but for the felt under the key front, which the key may meet before the strike",
              "lost by then elsewhere, % of the work put in", lost_elsewhere, "%", "to 5"),
        check("4.4", "afterwards a parameter can change the motion drastically",
              f"largest RMS difference after the strike, % of range ({most})", after[most], "%", "from 10"),
    ]  # fmt: skip


def lost_before_strike(action: model.Action, time_s: Array, force_n: Array, strike_s: float) -> tuple[float, float]:
    """Energy lost until the hammer meets the string, in all and without the felt under the key front, % of the work."""
    end = np.array([strike_s])
    solution = model.simulate(action, time_s, force_n, output_time_s=end, energy=True, inside=True)
    energy, inside = solution.energy, solution.inside
    assert energy is not None and inside is not None
    front = float(inside.felt_j[-1, inside.contacts.index("contact02")]) if "contact02" in inside.contacts else 0.0
    return 100.0 * energy.loss / energy.work_in, 100.0 * (energy.loss - front) / energy.work_in


def check_all(action: model.Action, time_s: Array, force_n: Array) -> list[Observation]:
    """All observations on an action: its own piano, and a forte of which the times and forces are given."""
    soft = model.study.compare(action, *model.force_table("piano"), PIANO_VARIANTS)
    hard = model.study.compare(action, time_s, force_n, FORTE_VARIANTS)
    strike_s = hard.measures[0].strike_s
    if not np.isfinite(strike_s):
        raise SystemExit("forte: the hammer never meets the string; allowed a blow that makes it strike")
    lost = lost_before_strike(action, time_s, force_n, strike_s)
    return [*check_piano(soft), *check_forte(hard), *check_strike(hard, *lost)]


def run(action: model.Action, time_s: Array, force_n: Array) -> tuple[list[str], dict[str, Any]]:
    """Which of the thesis's observations hold: lines of text, and the numbers."""
    observations = check_all(action, time_s, force_n)
    held = sum(o.holds for o in observations)
    lines = [f"Observations of the thesis: {held} of {len(observations)} hold here"]
    for o in observations:
        place = f"{'Sec.' if o.figure == '4.4' else 'Fig.'} {o.figure}"
        lines.append(f"{'holds' if o.holds else 'NOT':<6} {place:<10} {o.statement}")
        lines.append(f"{'':<17} {o.judged_by}: {o.found:.3g}{f' {o.unit}' if o.unit else ''} (allowed {o.allowed})")
    return lines, {"hold": held, "rows": [o._asdict() for o in observations]}
