"""Trial plans: order by seed, warm-up, rest, prompts; what was interrupted or rejected is played again."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from rig import ActionInfo, InputError, NotPermitted, Session
from rig import resume as resume_session
from rig.configuration.toml_file import dump_toml
from rig.recording.resume import due_entries
from rig.recording.trial_plan import WARM_UP_REASON, parse_plan
from tests.rig.fake_backend import FakeBackend
from tests.rig.recording.test_recorder import stop_at

PLAN = """
schema = "piano-action-rig plan 1"
name = "two levels"
order = "{order}"
seed = {seed}
rest_s = 1.5
warm_up = 1
[[conditions]]
name = "loud"
profile = "step.toml"
repeats = 2
[[conditions]]
name = "soft"
profile = "soft.toml"
repeats = 2
prompt = "{prompt}"
[action]
name = "Boston"
[action.regulation]
let_off_m = 1.1e-3
[action.added_masses]
load_cell_kg = 0.0042
[room]
temperature_c = 21.5
"""


@pytest.fixture
def make_plan(tmp_path, step_profile):
    (tmp_path / "step.toml").write_text(step_profile.text)
    (tmp_path / "soft.toml").write_text(step_profile.text.replace("force_n = 6", "force_n = 4").replace("step", "soft"))

    def make(order: str = "randomised", seed: int = 3, prompt: str = ""):
        return parse_plan(PLAN.format(order=order, seed=seed, prompt=prompt), "plan.toml", tmp_path)

    return make


def test_the_order_follows_from_the_seed_and_counts_are_kept(make_plan) -> None:
    orders = {seed: [entry.condition for entry in make_plan(seed=seed).entries] for seed in range(12)}
    assert orders[3] == [entry.condition for entry in make_plan(seed=3).entries]
    assert len({tuple(order) for order in orders.values()}) > 3
    for order in orders.values():
        assert Counter(order[1:]) == {"loud": 2, "soft": 2} and order[0] == order[1]
    for seed in range(6):
        order = [entry.condition for entry in make_plan("blocks", seed).entries][1:]
        assert set(order[:2]) == set(order[2:]) == {"loud", "soft"}
    assert [e.condition for e in make_plan("listed").entries] == ["loud", "loud", "loud", "soft", "soft"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "soft"', 'name = "Loud"', "each needs a name of its own"),
        ("repeats = 2", "repeats = 0", "repeats = 0"),
        ('order = "listed"', 'order = "any"', "order = 'any'"),
        ("rest_s = 1.5", "rest_s = nan", "rest_s"),
        ('profile = "soft.toml"', 'profile = "none.toml"', "no such profile"),
        ("seed = 3", "sed = 3", "unknown key sed"),
    ],
)
def test_a_bad_plan_is_one_line(make_plan, tmp_path, old: str, new: str, words: str) -> None:
    make_plan()
    text = PLAN.format(order="listed", seed=3, prompt="")
    assert old in text
    with pytest.raises(InputError) as caught:
        parse_plan(text.replace(old, new, 1), "plan.toml", tmp_path)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_plan_is_played_in_order_with_rest_and_its_warm_up_rejected(rig, make_plan, record_steps) -> None:
    backend, plan, asked = FakeBackend(), make_plan("listed", prompt="add 20 g"), []
    left: list[float | None] = []

    def ask(question: str) -> str:
        asked.append(question)
        return ""

    session = record_steps(rig, plan=plan, backend=backend, ask=ask, progress=lambda at: left.append(at.left_s))
    session = Session.open(session.path)
    assert [t.read().condition for t in session.trials] == ["loud", "loud", "loud", "soft", "soft"]
    assert [t.read().plan_entry for t in session.trials] == [1, 2, 3, 4, 5]
    assert [t.rejected for t in session.trials] == [WARM_UP_REASON, None, None, None, None]
    peaks = [t.read().motor_command_v.max() * 12 for t in session.trials]
    np.testing.assert_allclose(peaks, [6, 6, 6, 4, 4])
    assert backend.waited_s == [1.5] * 4 and len(asked) == 1 and "Trial 4, condition soft: add 20 g" in asked[0]
    assert left[0] is None and left[-1] is not None and left[-1] >= 0
    info = session.info
    assert info.action.regulation.let_off_m == 1.1e-3 and info.action.regulation.drop_m == "unknown"
    assert info.action.added_masses.load_cell_kg == 0.0042 and info.room.temperature_c == 21.5
    assert info.room.relative_humidity_percent == "unknown" and info.plan.order[3] == "soft"
    assert (session.path / "plan.toml").read_text() == plan.text
    assert due_entries(session) == []


def test_a_prompt_that_finds_nobody_moves_nothing(tmp_path, rig, make_plan, record_steps) -> None:
    with pytest.raises(NotPermitted, match="add 20 g"):
        record_steps(rig, plan=make_plan("listed", prompt="add 20 g"), ask=lambda question: None)
    session = Session.open(tmp_path / "s")
    assert [t.read().condition for t in session.trials] == ["loud"] * 3  # what came before the prompt is kept


def test_what_was_interrupted_or_rejected_is_played_again_under_new_numbers(
    tmp_path, rig, make_plan, record_steps
) -> None:
    with pytest.raises(KeyboardInterrupt):
        record_steps(rig, plan=make_plan("listed"), progress=stop_at(3, 0.3, KeyboardInterrupt()))
    session = Session.open(tmp_path / "s")
    assert [t.status for t in session.trials] == ["complete", "complete", "interrupted"]
    session.annotate(2, "reject", "somebody knocked", author="ana")
    assert [entry.number for entry in due_entries(session)] == [2, 3, 4, 5]
    backend = FakeBackend()
    numbers: list[int] = []
    resumed = resume_session(session.path, backend, opened=numbers.append)
    assert numbers == [3] and [t.number for t in resumed.trials] == [1, 2, 3, 4, 5, 6, 7]
    assert [t.read().plan_entry for t in resumed.trials] == [1, 2, 3, 2, 3, 4, 5]
    assert [t.read().condition for t in resumed.trials[3:]] == ["loud", "loud", "soft", "soft"]
    with pytest.raises(InputError, match="nothing to resume"):
        resume_session(session.path, backend)


def test_a_changed_copy_is_refused(rig, make_plan, record_steps) -> None:
    session = record_steps(rig, plan=make_plan("listed"))
    session.annotate(4, "reject", "noise")
    (session.path / "profile_soft.toml").write_text("name = 'x'")
    with pytest.raises(InputError, match=r"profile_soft\.toml: is not the file the session was begun with"):
        resume_session(session.path, FakeBackend())


def test_text_in_an_older_file_becomes_a_note() -> None:
    action = ActionInfo.model_validate({"regulation": "by the shop, 2025", "added_masses": "unknown"})
    assert action.regulation.note == "by the shop, 2025" and action.added_masses.load_cell_kg == "unknown"
    assert 'note = "by the shop, 2025"' in dump_toml({"action": action.model_dump()})
