"""Sessions whose report said something false: no sentence of theirs names a cause, and what is said is what is so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from rig.session import Session, SessionInfo, TrialData
from rig.session.info import FileInfo
from tests.validation.bench_strokes import BEFORE_S, FILMED, Change, Stroke, delayed, film, recount, stroke_of
from validation import compare as compare_session

CAUSES = (
    "not regulated", "let-off button", "drop screw", "its scale is wrong", "scale of one of them", "lifts off",
    "frame times are", "is faulty", "was disturbed", "may have changed", "clocks differ", "counts were lost",
    "zero drifts", "is wired", "its friction is not",
)  # fmt: skip
"""Words of a cause: no finding says why."""


def unchanged(data: TrialData, _: Stroke) -> TrialData:
    return data


def frozen_in(trial: int, column: int) -> Callable[[int], Change]:
    """An encoder holds its count from 0.29 to 0.32 s in one trial."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        inside = (data.time_s >= 0.29) & (data.time_s < 0.32)

        def hold(c: np.ndarray) -> np.ndarray:
            c[inside, column] = c[np.flatnonzero(inside)[0], column]
            return c

        return recount(data, hold)

    return lambda number: change if number == trial else unchanged


def cut(start_s: float, end_s: float) -> Change:
    """A record of a part of the stroke, times from zero."""

    def change(data: TrialData, _: Stroke) -> TrialData:
        keep = (data.time_s >= start_s) & (data.time_s < end_s)
        parts = {name: getattr(data, name)[keep] for name in ("raw_force_n", "force_raw", "motor_command_v")}
        time, count = data.time_s[keep], data.encoder_count[keep]
        blow = max(data.blow_start_s - start_s, 0.0)
        return replace(data, time_s=time - time[0], encoder_count=count - count[0], blow_start_s=blow, **parts)

    return change


def drifting_force(data: TrialData, _: Stroke) -> TrialData:
    return replace(data, raw_force_n=data.raw_force_n + 4.5 * data.time_s)


@dataclass(frozen=True)
class Case:
    """A session: kinds of its trials in turn, how each is played and misread, and what its findings say, or never."""

    kinds: Sequence[str]
    said: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    play: Callable[[int], dict[str, Any]] = lambda number: {}
    misread: Callable[[int], Change] = lambda number: unchanged
    filmed: bool = False


CASES = {
    "the shank bends": Case(6 * ["rebound"], never=("regulate", "16.2"), play=lambda n: {"effects": ("shank",)}),
    "the string yields": Case(
        6 * ["ff2"], ("encoder hammer: in all 6 trials it travels 1.05",), play=lambda n: {"effects": ("string",)}
    ),
    "frozen whippen, filmed": Case(
        6 * ["mf"], ("trial 2: encoder whippen: its count does not change for 29.8 ms",), ("early", "late"),
        misread=frozen_in(FILMED, 1), filmed=True,
    ),
    "let-off 0.9 mm off from trial 3 of 5 on": Case(
        5 * ["mf"], ("from trial 3 on the difference from the model in", "(3 of 5 trials)"),
        ("all trials", "stands out", "Record again"),
        play=lambda n: {"changed": (("contact08.second.y", 0.9e-3),)} if n > 2 else {},
    ),
    "a trial drifts before the blow": Case(
        3 * ["mf"], ("trial 2 is not used: quiet baseline is",),
        misread=lambda n: drifting_force if n == 2 else unchanged,
    ),
    "force later by 0.5 ms each trial": Case(
        6 * ["rebound"], ("from trial 3 on (4 of 6 trials)", "2.4 ms more in trial 6"), ("all trials",),
        misread=lambda n: delayed(0.5e-3 * (n - 1)),
    ),
    "key down at the start": Case(
        4 * ["mf"], ("trial 4: the record does not begin at rest",), ("swapped", "wrong way", "Exchange"),
        misread=lambda n: cut(0.40, np.inf),
    ),
    "three kinds": Case(
        ["mf", "mf", "piano", "piano", "double", "double"], ("3 kinds of stroke: trials 1, 2",),
        ("short record", "record it again"),
    ),
    "trials end before let-off": Case(4 * ["mf"], misread=lambda n: cut(0.0, BEFORE_S + 0.035)),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_is_said_of_a_session_is_so(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    rig, profile = FileInfo(name="none"), FileInfo(name=case.kinds[0])
    info = SessionInfo(simulated=True, name="planted", operator="bench", rig=rig, profile=profile)
    session = Session.create(tmp_path / "session", info)
    for number, kind in enumerate(case.kinds, 1):
        stroke = stroke_of(kind, 1, number, tuple(case.play(number).items()))
        data = case.misread(number)(stroke.data, stroke)
        if case.filmed and number == FILMED:
            camera, table = film(stroke, 0.0, np.random.default_rng(1))
            data = replace(data, camera=camera)
        session.add_trial(data)
        if data.camera is not None:
            session.write_derived("angles", number, table)
    result = compare_session(session, model.load_action(), keep_predictions=False, budget=False, explain=False)
    findings = "\n".join(result.findings["text"])
    marked = [f"trial {row.trial}: {row.reason}" for row in result.marked.itertuples()]
    text = "\n".join([findings, *result.warnings, *result.verdict_lines, *marked])
    assert not [word for word in (*CAUSES, *case.never) if word in text]
    assert all(words in findings for words in case.said), findings
    assert bool(findings) == bool(case.said)
    marked_out = [f.trial for f in result.findings.itertuples() if f.kind == "not used"]
    assert all(f"trial {n:.0f} (not used)" in text for n in marked_out)
