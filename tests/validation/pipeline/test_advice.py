"""The head of a report says what to do: a closed list, each sentence by its trigger."""

from __future__ import annotations

import math
from dataclasses import replace

import pandas as pd

from validation.findings.finding import KINDS, OTHER_PROGRAM, SessionFinding
from validation.infer.causes.explain import CompatibleChange, Explained
from validation.pipeline import advice
from validation.result import AGREES, DIFFERS
from validation.statistics.rivals import Rivals
from validation.statistics.skill import Skill

NO_PLACES = pd.DataFrame({"trial": [], "fitted": [], "why_outside": []})


def rivals(places: pd.DataFrame = NO_PLACES, skill: dict[str, Skill] | None = None) -> Rivals:
    return Rivals(pd.DataFrame(), skill or {}, places, (), (), "")


def found(kind: str, trial: float = math.nan, channel: str = "hammer", value: float = 1.1e-3) -> SessionFinding:
    return SessionFinding(kind, trial, channel, value, 0.0, "text")


def change(number: int, cause: str, unit: str = "1") -> CompatibleChange:
    """A change of a set that all trials share."""
    return CompatibleChange(number, 1, cause, 1.05, 0.01, unit, 0.0, 0.1, 0.05)


def test_every_finding_but_a_lifting_key_has_its_sentence_and_no_other_has() -> None:
    assert set(KINDS) - set(advice.MEND) <= {"capstan gap", "not used"} and set(advice.MEND) < set(KINDS)
    for kind in advice.MEND:
        (said,) = advice.advise_on_findings([found(kind, 3.0), found(kind, 5.0)])
        assert said.endswith((".", ").")) and "{" not in said


def test_a_fault_that_spoils_the_comparison_is_all_that_is_said() -> None:
    explained = Explained("x", (change(1, "hammer.mass"),))
    said = advice.what_to_do([found("force gain")], explained, rivals(), DIFFERS)
    assert said == (advice.MEND["force gain"],) and "loosen nothing" in said[0]
    said = advice.what_to_do([found("hum", 1.0, "force")], explained, rivals(), DIFFERS)
    assert said[0] == advice.MEND["hum"] and "hammer.mass" in said[1]


def test_who_imported_a_recording_changes_the_mapping() -> None:
    """No sentence of a finding sends somebody to a rig file who has none."""
    for kind in advice.MEND:
        (said,) = advice.advise_on_findings([found(kind)], OTHER_PROGRAM)
        assert "rig file" not in said and "{" not in said
    said = advice.what_to_do([found("sign flip")], Explained(), rivals(), DIFFERS, OTHER_PROGRAM)
    assert said[-1] == "Turn the sign of the encoder in the mapping and import again."
    assert advice.advise_on_findings([found("sign flip")])[0].endswith("in the rig file and record again.")


def test_causes_are_measured_alone_or_told_apart() -> None:
    one = Explained("x", (change(1, "hammer.mass"), change(1, "key.mass")))
    assert advice.advise_on_causes(one) == [
        "Measure hammer.mass and key.mass, which alone of the causes compared explain the difference."
    ]
    several = Explained("x", tuple(change(n, f"part {n}") for n in range(1, 6)))
    (said,) = advice.advise_on_causes(several)
    assert "part 1 or part 2 or part 3 or 2 more" in said and "cannot tell" in said
    (said,) = advice.advise_on_causes(Explained("x", (change(1, "force gain"),)))
    assert said.startswith("Calibrate the bench") and "loosen nothing" in said
    (said,) = advice.advise_on_causes(Explained("x", (replace(change(1, "hammer.mass"), changes=2),)))
    assert said == "Measure hammer.mass, which is a part of what makes the difference."
    pairs = [replace(change(n, cause), changes=2) for n, one in enumerate(("ab", "ac"), 1) for cause in one]
    (said,) = advice.advise_on_causes(Explained("x", tuple(pairs)))
    assert said == "Measure a, and b or c: the trials cannot tell which of them goes with it."
    (said,) = advice.advise_on_causes(Explained("x", (change(1, "tau"), change(2, "tau"))))  # two sizes
    assert said == "Measure tau, which alone of the causes compared explains the difference."
    step = replace(change(2, "force gain"), profile="step", first=4, last=6)
    (said,) = advice.advise_on_causes(Explained("x", (change(1, "law a"), step)))
    assert said == "Measure law a or force gain: the trials cannot tell which of them makes the difference."
    both = replace(change(1, "law a"), changes=2), replace(step, set=1, changes=2)
    (said,) = advice.advise_on_causes(Explained("x", both))
    assert said == "Measure law a, which with force gain explains the difference."
    (said,) = advice.advise_on_causes(Explained("x", (replace(change(1, "force gain"), changes=2),)))
    assert said == "Measure force gain, which is a part of what makes the difference."  # the other part may be a law
    drift = CompatibleChange(1, 1, "force gain", 1.05, 0.01, "1", 0.0, 0.1, "trend", 1, 6)
    assert not advice.advise_on_causes(Explained("x", (drift,)))  # a finding says it


def test_strokes_outside_of_what_was_fitted() -> None:
    places = pd.DataFrame(
        {
            "trial": [1, 4, 6],
            "fitted": [True, False, False],
            "why_outside": ["speed", "repetition: no fitted stroke has it", ""],
        }
    )
    said = advice.what_to_do([], Explained(), rivals(places), AGREES)
    assert said == ("Record repetitions and identify again before you trust the model there.",)
    assert advice.advise_on_domain({3: "", 7: "fastest way down of the key 2, fitted up to 1 1/s", 5: "x"}) == [
        "Record strokes like trials 5, 7 and identify again before you trust the model there."
    ]


def test_at_most_three_and_nothing_to_do() -> None:
    many = [found(kind, 1.0) for kind in advice.MEND]
    assert len(advice.what_to_do(many, Explained(), rivals(), DIFFERS)) == advice.MOST == 3
    assert advice.what_to_do([], Explained(), rivals(), AGREES) == (advice.NOTHING,)
    assert advice.what_to_do([], Explained(), rivals(), DIFFERS) == ()


def test_several_conditions_come_before_what_is_of_one_and_nothing_is_said_twice() -> None:
    every = [found(kind) for kind in ("travel difference", "let-off", "check height", "changed condition")]
    assert advice.advise_on_findings(every)[0] == KINDS["changed condition"].mend
    assert len(advice.advise_on_findings([found("force lag"), found("force delay")])) == 1
