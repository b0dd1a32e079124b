"""What a scientist writes in a notebook without reading: open, iterate, correct, simulate."""

from __future__ import annotations

import pickle
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import xarray
from threadpoolctl import threadpool_info, threadpool_limits

import model
import rig
import validation

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
    measured = trial.angle_rad[:, 2]
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
    with pytest.raises(model.InputError, match="force: found ndarray, allowed time_s and force_n, or a recorded trial"):
        model.simulate(ACTION, time_s)


def turned(values):
    return np.degrees(values - values[0])


def test_a_recording_and_a_prediction_lie_on_each_other(session):
    """Axes in, axes out; angles are turns in degrees in both, so that one picture compares them."""
    trial, solution = session[1], model.simulate(ACTION, session[1])
    axes = trial.plot()
    assert solution.plot("hammer", ax=axes) is axes
    drawn = {(line.get_label(), line.get_linestyle()): line for line in axes.lines}
    np.testing.assert_allclose(drawn["hammer", "-"].get_ydata(), turned(trial.read().angle_rad[:, 2]))
    np.testing.assert_allclose(drawn["hammer, model", "--"].get_ydata(), turned(solution["hammer"]))
    np.testing.assert_array_equal(trial.plot("force_n").lines[0].get_ydata(), trial.force_n)
    assert solution.plot("key", ax=axes, ls=":", c="red").lines[-1].get_color() == "red"
    assert {label for label, _ in drawn} == {
        "key",
        "whippen",
        "hammer",
        "hammer, model",
    } and axes.get_xlabel() == "time, s"
    plt.close("all")


def test_results_are_tables_and_files_with_units(session, tmp_path):
    trial, solution = session[2], model.simulate(ACTION, *model.force_table("piano"), contact_forces=True)
    for result, column, unit in ((trial, "raw_force_n", "N"), (solution, "hammer_rad_per_s", "rad/s")):
        frame = result.to_frame()
        assert frame.attrs["units"][column] == unit and frame.attrs["units"].keys() == set(frame)
        np.testing.assert_array_equal(frame[column], result[column])
        csv = pd.read_csv(result.save(tmp_path / "one.csv"))
        np.testing.assert_allclose(csv[column], result[column], rtol=1e-15, atol=0)
        with xarray.open_dataset(result.save(tmp_path / "one.h5"), engine="h5netcdf") as opened:
            assert opened[column].attrs["units"] == unit and opened[column].dims == ("time_s",)
        with pytest.raises(ValueError, match=r"one\.txt: ending found '\.txt', allowed \.csv, \.h5, \.parquet"):
            result.save(tmp_path / "one.txt")
        with pytest.warns(DeprecationWarning, match=r"to_table\(\) is to_frame\(\) now"):
            assert result.to_table().equals(frame)
    np.testing.assert_array_equal(trial["force_n"], trial.read().force_n)
    assert session.to_frame()["trial"].tolist() == [1, 2, 3]


def test_bodies_and_contacts_go_by_their_names():
    solution = model.simulate(ACTION, *model.force_table("forte"), contact_forces=True)
    np.testing.assert_array_equal(solution["jack"], solution.angle_rad[:, 2])
    check = solution.contacts["back check"]
    np.testing.assert_array_equal(check.normal_n, solution.contact_normal_n[:, solution.contacts.index("contact04")])
    assert check.normal_n.max() > 1.0 and check.name == "contact04" == solution.contacts[3]
    assert "back check (04)" in repr(solution.contacts)
    height = model.observables.hammer_height_m(ACTION, solution.angle_rad)
    np.testing.assert_array_equal(solution.hammer_height_m, height)
    with pytest.raises(model.InputError, match=r"contact 'bak check': not in this scene; did you mean back check\?"):
        solution.contacts["bak check"]
    with pytest.raises(model.InputError, match="no column 'hamer'; there are time_s, key_rad"):
        solution["hamer"]
    with pytest.raises(model.InputError, match="give contact_forces=True"):
        model.simulate(ACTION, *model.force_table("piano")).contacts["back check"]


def test_an_action_a_scene_and_sensitivities_show_themselves(session, tmp_path):
    action = model.load_action(ACTION, {"hammer.mass": 0.0121})
    assert repr(action).count("\n") < 12 and "hammer.mass = 0.0121" in repr(action)
    frame = action.to_frame().set_index("parameter")
    assert (frame["value"]["hammer.mass"], frame["unit"]["hammer.mass"]) == (0.0121, "kg")
    assert model.load_action(action.save(tmp_path / "mine.toml"))["hammer.mass"] == 0.0121
    axes = action.plot()
    pivot = next(line for line in axes.lines if line.get_label() == "hammer")
    np.testing.assert_allclose(pivot.get_xydata(), [[1e3 * action["hammer.pivot.x"], 1e3 * action["hammer.pivot.y"]]])
    scene = model.build_scene(action)
    assert scene.to_frame()["first"][3] == "hammer" and len(scene.plot().lines) == 13 and len(repr(scene)) < 100
    found = model.sensitivities(action, session[1], ["hammer.mass"])
    row = found.to_frame().iloc[0]
    assert row["value"] == 0.0121 and row["d_strike_m_per_s"] == found.d_events["strike_m_per_s"][0] < 0.0
    (line,) = found.plot().lines
    np.testing.assert_allclose(line.get_ydata(), np.degrees(0.01 * 0.0121 * found.d_angles[:, 4, 0]))
    assert found.save(tmp_path / "found.csv").read_text().startswith("parameter,value,unit,u,d_")
    plt.close("all")


@pytest.mark.parametrize(
    ("package", "function"),
    [
        ("touch", "model.measure_touch(action)"),
        ("sensitivity", "model.sensitivities(action, trial, parameters)"),
        ("regulation", "model.regulate(action)"),
        ("study", "model.study.compare(action, time_s, force_n, variants)"),
        ("batch", "model.simulate_many(action, trials)"),
        ("inside", "model.simulate(action, trial, inside=True)"),
    ],
)
def test_a_package_that_is_called_names_the_function(package, function):
    found = getattr(model, package)
    with pytest.raises(TypeError) as refused:
        found(ACTION)
    assert str(refused.value) == f"model.{package} is a package, not a function; call {function}"
    name = function.partition("(")[0].rpartition(".")[2]
    assert callable(getattr(found if ".study." in function else model, name))


def test_former_and_half_names_lead_to_the_new_ones():
    assert model.touch.feel is model.measure_touch and model.touch.Feel is model.Touch
    with pytest.warns(DeprecationWarning, match=r"validation\.correct_force is rig\.correct_force now"):
        assert validation.correct_force is rig.correct_force
    with pytest.raises(model.InputError, match="scene 'shank': not found; did you mean flexible-shank"):
        model.simulate(ACTION, *model.force_table("piano"), scene="shank")


def test_the_peak_is_that_of_the_corrected_force(session):
    trial = session[1].read()
    assert trial.peak_force_n == trial.corrected_force().force_n.max() < trial.raw_force_n.max()
    assert session.to_frame()["peak_force_n"][0] == trial.peak_force_n
    assert trial.duration_s == pytest.approx(len(trial.time_s) / 5000.0)


def test_a_trial_is_asked_for_by_one_number(session, tmp_path):
    for wrong in ("1", slice(1, 3), 1.5):
        with pytest.raises(rig.RigInputError, match=r"trial: found .*, allowed one number; list\(session\) can be cut"):
            session[wrong]
    with pytest.raises(rig.RigInputError, match=r"session\.toml is missing; it holds the sessions .*example_forte"):
        rig.open_session(SESSION.parent)
    with pytest.raises(rig.RigInputError, match=r"session\.toml is missing$"):
        rig.open_session(tmp_path)


def test_what_drives_a_simulation_is_named_in_the_functions_words():
    for keywords, words in [
        ({}, r"model\.simulate\(\) needs time_s and force_n, or a recorded trial"),
        ({"time": [0.0], "force": [0.0]}, r"unexpected keyword argument 'time'; did you mean 'time_s'\?"),
    ]:
        with pytest.raises(TypeError, match=words):
            model.simulate(ACTION, **keywords)
    with pytest.raises(model.InputError, match=r"found str, .* read it by model\.read_force_table\('force\.csv'\)"):
        model.simulate(ACTION, "force.csv")
    with pytest.raises(model.InputError, match="action: found list, allowed one action: a model.Action"):
        model.rest_state([ACTION])


def test_a_session_is_a_batch_of_its_corrected_forces(session):
    """Each member is the single run of its trial: from rest under the preload, rows at the samples."""
    members = model.simulate_many(ACTION, session, [{}, {"hammer.mass": 0.0125}])
    assert [(m.trial, m.parameters, m.error) for m in members] == [(n, s, None) for s in "01" for n in "123"]
    alone = model.simulate(model.load_action(ACTION, {"hammer.mass": 0.0125}), session[2])
    np.testing.assert_allclose(members[4].solution.angle_rad, alone.angle_rad, atol=2e-5)
    np.testing.assert_array_equal(members[4].solution.time_s, alone.time_s)
    with pytest.raises(model.InputError, match="parameter_sets: 'hammer.mass': found list, allowed path -> value for"):
        model.simulate_many(ACTION, session, {"hammer.mass": [0.011, 0.012]})
    (driven,) = model.simulate_many(ACTION, [session[1]], scene="finger")
    assert "a trial has a force, this scene is driven by finger_m" in str(driven.error)


def test_a_corrected_force_is_a_table_and_a_curve(session):
    force = session[1].corrected_force()
    frame = force.to_frame()
    assert list(frame) == ["time_s", "force_n", "u_force_n"] and set(frame.attrs["units"].values()) == {"s", "N"}
    np.testing.assert_array_equal(force.plot().lines[0].get_ydata(), force.force_n)
    assert repr(force).startswith("<CorrectedForce: 6300 samples, largest 33.44 N at 0.4")
    plt.close("all")


def test_comparing_takes_one_thread_of_linear_algebra_and_gives_the_others_back(session):
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    seen: list[set[int]] = []
    with threadpool_limits(2, "blas"):
        before = threads()
        validation.compare(session, budget=False, explain=False, progress=lambda _: seen.append(threads()))
        assert threads() == before
    assert seen and all(found == {1} for found in seen)


def test_a_result_names_the_table_that_was_meant(session):
    result = validation.compare(session, budget=False, explain=False)
    with pytest.raises(AttributeError, match="no attribute or table 'score'; did you mean scores"):
        result.score  # noqa: B018
    with pytest.raises(AttributeError, match="no attribute or table 'qqq'; tables are channels, "):
        result.qqq  # noqa: B018
    assert repr(pickle.loads(pickle.dumps(result))) == repr(result)
