"""The sensitivity studies of the thesis (Figs 4.9-4.11, 4.16-4.19) repeated, each of its observations a computed check.

The thesis's statements are qualitative; every check names the number it judges by and its limit
(docs/explanation/null_model.md). "Range" is the widest turn of that body in the action as given. The measured
forces are not printed, so the blows follow their description (`model.files.force_library`); another forte may be
given. What the thesis compares with its experiment cannot be checked here and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.force_library import force_table
from model.files.force_table import check_force_table
from model.force_driven import simulate
from model.parameters.action import KEY_FRONT, STRING, Action
from model.study.variants import AS_GIVEN, Study, Variant, compare

Array = NDArray[np.float64]

INCREASED = Variant("damping x 4.5", factors={"damping": 4.5})
DECREASED = Variant("damping / 10", factors={"damping": 0.1})
UNDAMPED = Variant("no damping", factors={"damping": 0.0, f"{STRING}.normal.D": 0.0})
UNDAMPED_BUT_STRING = Variant("no damping but the string's", factors={"damping": 0.0})
SLIPPERY = Variant("no tangential friction", factors={"friction": 0.0})
SLIPPERY_CHECK = Variant("no friction at the back check", values={"contact04.friction": 0.0})
LOOSE = Variant("no rotational friction", factors={"joint_friction": 0.0})

FIGURES = (
    ("4.9", "piano", "key", (INCREASED,)),
    ("4.10", "piano", "whippen", (INCREASED,)),
    ("4.11", "piano", "hammer", (INCREASED,)),
    ("4.16", "forte", "hammer", (DECREASED,)),
    ("4.17", "forte", "hammer", (UNDAMPED, UNDAMPED_BUT_STRING)),
    ("4.18", "forte", "hammer", (SLIPPERY, SLIPPERY_CHECK)),
    ("4.19", "forte", "hammer", (LOOSE,)),
)


@dataclass(frozen=True)
class Observation:
    """One statement of the thesis and its check on the model.

    Attributes
    ----------
    figure : figure or section of the thesis
    statement : the observation in short
    judged_by : the number that decides
    found : its value, in ``unit``
    allowed : its limit, as text
    holds : whether the observation is confirmed
    """

    figure: str
    statement: str
    judged_by: str
    found: float
    unit: str
    allowed: str
    holds: bool


@dataclass(frozen=True)
class ThesisStudy:
    """Both blows with their variants, and the thesis's observations checked on them."""

    piano: Study
    forte: Study
    observations: tuple[Observation, ...]


def thesis_studies(action: Action, forte: tuple[ArrayLike, ArrayLike] | None = None) -> ThesisStudy:
    """Repeat the studies of Sections 4.2.2 and 4.4.

    Parameters
    ----------
    action : the thesis used its own, regulated
    forte : times (k,) s and forces (k,) N of the strong blow; by default after Fig. 4.1

    Returns
    -------
    ThesisStudy
        Both blows with their variants, and which of the thesis's observations hold.

    Raises
    ------
    InputError : a strong blow whose hammer never meets the string

    Examples
    --------
    >>> import model
    >>> studies = model.study.thesis_studies(model.load_action("hirschkorn2004"))
    >>> len(studies.observations)
    22
    """
    time, force = force_table("thesis-forte") if forte is None else check_force_table(*forte)
    soft = compare(action, *force_table("piano"), [INCREASED])
    hard = compare(action, time, force, [DECREASED, UNDAMPED, UNDAMPED_BUT_STRING, SLIPPERY, SLIPPERY_CHECK, LOOSE])
    if not np.isfinite(hard.measures[0].strike_s):
        raise InputError("forte: the hammer never meets the string; allowed a blow that makes it strike")
    lost = _lost_before_strike(action, time, force, hard)
    return ThesisStudy(soft, hard, (*_soft(soft), *_hard(hard), *_strike(hard, *lost)))


def _share(study: Study, name: str, body: str, start: float = -np.inf, end: float = np.inf) -> float:
    """Largest difference from the action as given, % of the body's range; NaN where there is no such time."""
    away = study.difference(name, body, start, end)
    return 100.0 * float(np.max(np.abs(away))) / study.range(body) if len(away) else float("nan")


def _rms(study: Study, name: str, body: str = "hammer", start: float = -np.inf) -> float:
    """Root mean square difference, % of the body's range."""
    return 100.0 * float(np.sqrt(np.mean(study.difference(name, body, start) ** 2))) / study.range(body)


def _check(
    figure: str, statement: str, judged_by: str, found: float, unit: str, allowed: str, holds: bool | None = None
) -> Observation:
    """An observation; it holds where ``found`` is within ``allowed`` ("to 5", "from 10"), if nothing else is said."""
    if holds is None:
        side, limit = allowed.split()
        holds = bool(found <= float(limit) if side == "to" else found >= float(limit))
    return Observation(figure, statement, judged_by, found, unit, allowed, holds)


def _soft(study: Study) -> list[Observation]:
    later = study[INCREASED.name][1].strike_s - study[AS_GIVEN][1].strike_s
    return [
        *(
            _check(
                figure,
                f"piano: damping for soft blows leaves the {body}'s motion nearly identical",
                "largest difference, % of range",
                _share(study, INCREASED.name, body),
                "%",
                "to 5",
            )
            for figure, body in (("4.9", "key"), ("4.10", "whippen"), ("4.11", "hammer"))
        ),
        _check("4.11", "piano: it does not take away the delay before the strike", "strike later by",
               1e3 * later, "ms", "to 1"),
    ]  # fmt: skip


def _hard(study: Study) -> list[Observation]:
    name = DECREASED.name
    given, changed = study[AS_GIVEN][1], study[name][1]
    lower, strike = 1e3 * (changed.hold_m - given.hold_m), given.strike_s
    before = _share(study, name, "hammer", strike + 0.1, given.release_s)
    after = _share(study, name, "hammer", given.release_s)
    out = [
        _check("4.16", "a tenth of the damping: the hammer checks slightly lower", "hold lower by",
               lower, "mm", "0 to 5", bool(given.held and changed.held and 0.0 < lower <= 5.0)),
        _check("4.16", "it diverges slightly after the key is released",
               f"largest difference after release, % of range (before: {before:.1f})",
               after, "%", "more than before, to 20", bool(before < after <= 20.0)),
        _check("4.16", "the behaviour as a whole stays close", "RMS difference, % of range",
               _rms(study, name), "%", "to 5"),
    ]  # fmt: skip
    for one in (UNDAMPED, UNDAMPED_BUT_STRING):
        out += [
            _check("4.17", f"{one.name}: a large effect", "RMS difference, % of range",
                   _rms(study, one.name), "%", "from 10"),
            _not_held("4.17", f"{one.name}: the hammer is not held on the back check", study, one.name),
            _check("4.17", f"{one.name}: it keeps bouncing on the repetition lever",
                   "touches of knuckle and lever between strike and release",
                   study[one.name][1].lever_bounces, "", "from 3"),
        ]  # fmt: skip
    return [
        *out,
        _not_held("4.18", f"{SLIPPERY.name}: the hammer fails to check", study, SLIPPERY.name),
        _not_held("4.18", "friction at the back check alone decides that", study, SLIPPERY_CHECK.name),
        _check("4.19", f"{LOOSE.name}: no deviation between check and 0.50 s",
               "largest difference from 0.1 s after the strike to 0.50 s, % of range",
               _share(study, LOOSE.name, "hammer", strike + 0.1, 0.5), "%", "to 2"),
        _check("4.19", f"{LOOSE.name}: a minor deviation after 0.50 s", "largest difference after 0.50 s, % of range",
               _share(study, LOOSE.name, "hammer", 0.5), "%", "to 10"),
    ]  # fmt: skip


def _not_held(figure: str, statement: str, study: Study, name: str) -> Observation:
    m = study[name][1]
    judged_by = f"hammer moves in the last 0.1 s of the hold, {'held by' if m.held else 'not held by'} the check"
    moved = 1e3 * m.hold_moved_m
    return _check(figure, statement, judged_by, moved, "mm", "above 1, or off the check", not m.held)


def _strike(study: Study, lost: float, lost_elsewhere: float) -> list[Observation]:
    given = study[AS_GIVEN][1]
    others = {v.name: m for v, m in zip(study.variants[1:], study.measures[1:], strict=True)}

    def farthest(measure: str) -> tuple[str, float]:
        """The variant that changes it most, and its value; one that never strikes is infinitely far."""
        away = {name: abs(getattr(m, measure) - getattr(given, measure)) for name, m in others.items()}
        name = max(away, key=lambda n: away[n] if np.isfinite(away[n]) else np.inf)
        return name, getattr(others[name], measure)

    (late, strike_s), (fast, speed) = farthest("strike_s"), farthest("strike_m_per_s")
    after = {name: _rms(study, name, start=given.strike_s) for name in others}
    most = max(after, key=lambda name: after[name])
    return [
        _check("4.4", "none of the changes touches the initial strike: its time", f"largest change ({late})",
               1e3 * abs(strike_s - given.strike_s), "ms", "to 1"),
        _check("4.4", "none of the changes touches the initial strike: its speed", f"largest change ({fast})",
               100.0 * abs(speed / given.strike_m_per_s - 1.0), "%", "to 2"),
        _check("4.4", "friction and damping lose no significant energy before the strike",
               "lost by then, % of the work put in", lost, "%", "to 5"),
        _check("4.4", "the same, but for the felt under the key front, which the key may meet before the strike",
               "lost by then elsewhere, % of the work put in", lost_elsewhere, "%", "to 5"),
        _check("4.4", "afterwards a parameter can change the motion drastically",
               f"largest RMS difference after the strike, % of range ({most})", after[most], "%", "from 10"),
    ]  # fmt: skip


def _lost_before_strike(action: Action, time_s: ArrayLike, force_n: ArrayLike, study: Study) -> tuple[float, float]:
    """Energy lost until the hammer meets the string, in all and without the felt under the key front, % of the work."""
    end = np.array([study[AS_GIVEN][1].strike_s])
    solution = simulate(action, time_s, force_n, output_time_s=end, energy=True, inside=True)
    energy, inside = solution.energy, solution.inside
    assert energy is not None and inside is not None
    front = float(inside.felt_j[-1, inside.contacts.index(KEY_FRONT)]) if KEY_FRONT in inside.contacts else 0.0
    return 100.0 * energy.lost / energy.work_in, 100.0 * (energy.lost - front) / energy.work_in
