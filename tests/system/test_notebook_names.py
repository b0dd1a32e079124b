"""What a scientist writes in a notebook without reading: open, iterate, correct, simulate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
import rig

SESSION = Path(__file__).parents[2] / "sessions" / "example_forte"
ACTION = "hirschkorn2004-regulated"


@pytest.fixture(scope="module")
def session():
    return rig.open_session(SESSION)


def test_a_session_is_a_row_of_trials(session):
    assert len(session) == 3 and [trial.number for trial in session] == [1, 2, 3]
    assert session[2].number == 2
    assert repr(session) == f"Session({str(SESSION)!r}: 3 trials)"
    with pytest.raises(rig.RigInputError, match=r"no trial 4; there are \[1, 2, 3\]"):
        session[4]


def test_the_constructor_says_how_a_session_is_opened():
    with pytest.raises(rig.RigInputError, match=r"rig\.open_session\('lab'\)"):
        rig.Session("lab")


def test_a_trial_shows_itself_in_one_line(session):
    assert repr(session[1].read()) == "TrialData(1, complete: 1.26 s at 5000 Hz; force, key, whippen, hammer)"


def test_the_plain_name_is_the_corrected_force(session):
    trial = session[1].read()
    force = trial.corrected_force()
    quiet = slice(0, force.quiet.stop)
    assert force.force_n[quiet].mean() == pytest.approx(trial.force_info.preload_n, abs=1e-6)
    np.testing.assert_allclose(force.time_s, trial.time_s - trial.force_info.group_delay_s)
    at_samples = np.interp(trial.time_s, force.time_s, force.force_n)
    np.testing.assert_allclose(trial.force_n, at_samples)
    assert np.abs(trial.force_n - trial.raw_force_n).max() > 5.0  # 8 ms of delay on the flank of a forte blow


def test_a_trial_drives_the_model_as_its_corrected_force_does(session):
    """The naive call is the right one: rows at the samples, from rest under the preload, as `validate` runs it."""
    trial = session[1].read()
    solution = model.simulate(ACTION, trial)
    force = trial.corrected_force()
    action = model.load_action(ACTION)
    inside = trial.time_s <= force.time_s[-1]
    rest = model.rest_state(action, force_n=force.preload_n)
    wanted = model.simulate(action, force.time_s, force.force_n, initial=rest, output_time_s=trial.time_s[inside])
    np.testing.assert_allclose(solution.angle_rad[inside], wanted.angle_rad, atol=2e-5)
    assert solution.time_s.shape == trial.time_s.shape
    measured = trial.angle_rad()[:, 2]
    change = solution.angle_rad[:, 4] - solution.angle_rad[0, 4]
    naive = model.simulate(action, trial.time_s, trial.raw_force_n).angle_rad[:, 4]
    rms_deg = [np.degrees(np.sqrt(np.mean((x - x[0] - measured) ** 2))) for x in (change, naive)]
    assert rms_deg[0] < 0.5 < 2.0 < rms_deg[1]
    again = model.simulate(action, session[1])
    np.testing.assert_array_equal(again.angle_rad, solution.angle_rad)


def test_an_action_goes_by_name_or_file(tmp_path):
    time_s, force_n = model.force_table("piano")
    action = model.load_action(ACTION)
    file = tmp_path / "mine.toml"
    model.write_action(action, file)
    wanted = model.rest_state(action).angle_rad
    for name in (ACTION, file, str(file)):
        np.testing.assert_allclose(model.rest_state(name).angle_rad, wanted)
    assert model.simulate(ACTION, time_s, force_n).angle_rad.shape == (len(time_s), 5)
    with pytest.raises(model.InputError, match="built in: "):
        model.simulate("hirschkorn", time_s, force_n)
    with pytest.raises(model.InputError, match=r"found dict, allowed a model\.Action, a built-in name or a TOML file"):
        model.simulate({}, time_s, force_n)
    with pytest.raises(model.InputError, match="found ndarray and no force_n; give time_s and force_n, or a recorded"):
        model.simulate(ACTION, time_s)
