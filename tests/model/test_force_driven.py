"""Simulated blows against references made by an independent method (tests/model/data/make_reference.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
from model.force_driven import ForceDrivenRun
from model.integrators.methods import METHODS
from model.simulation.statics import solve_rest
from tests.model.conftest import read_table

BLOWS = ("forte", "piano", "noisy")


def reference(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    force, rows = read_table(f"{name}_force.csv"), read_table(f"{name}_reference.csv")
    return force[:, 0], force[:, 1], rows


@pytest.mark.parametrize(("blow", "method"), [(blow, model.DEFAULT_METHOD) for blow in BLOWS] + [("forte", "rodas5p")])
def test_default_tolerance_is_kept(action: model.Action, blow: str, method: str) -> None:
    time, force, rows = reference(blow)
    solution = model.simulate(action, time, force, output_time_s=rows[:, 0], method=method)
    assert np.abs(solution.angle_rad - rows[:, 1:6]).max() < 1e-5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("blow", BLOWS)
def test_tight_tolerance_reaches_the_reference(action: model.Action, blow: str, method: str) -> None:
    time, force, rows = reference(blow)
    solution = model.simulate(action, time, force, output_time_s=rows[:, 0], tolerance=1e-9, method=method)
    assert np.abs(solution.angle_rad - rows[:, 1:6]).max() < 2e-8
    assert np.abs(solution.speed_rad_per_s - rows[:, 6:]).max() < 1e-4


def test_error_falls_with_the_tolerance(action: model.Action) -> None:
    time, force, rows = reference("forte")
    errors, steps = [], []
    for tolerance in (1e-4, 1e-6, 1e-8):
        solution = model.simulate(action, time, force, output_time_s=rows[:, 0], tolerance=tolerance)
        errors.append(np.abs(solution.angle_rad - rows[:, 1:6]).max())
        steps.append(solution.counters["n_steps"])
    assert errors[0] < 1e-4 and errors[1] < 3e-6 and errors[2] < 3e-8
    # work, not time: order 4 with error control spends about 10^(1/4) per decade, kinks somewhat more
    assert steps[2] / steps[0] < 100**0.5 * 2
    assert steps[0] < 3500


def test_forces_at_output_times_follow_from_the_state(action: model.Action) -> None:
    from tests.model.verification.reference_equations import Twin

    time, force, _ = reference("forte")
    at = np.array([0.1071, 0.1123, 0.13])
    solution = model.simulate(action, time, force, output_time_s=at, contact_forces=True)
    twin = Twin(action)
    assert solution.contact_normal_n is not None and solution.contact_friction_n is not None
    for k in range(len(at)):
        twin._place(solution.angle_rad[k], solution.speed_rad_per_s[k])
        for c, name in enumerate(solution.contacts):
            normal, friction, _ = twin.contact(name, solution.speed_rad_per_s[k])
            assert solution.contact_normal_n[k, c] == pytest.approx(normal, abs=1e-9)
            assert solution.contact_friction_n[k, c] == pytest.approx(friction, abs=1e-9)


LAWS = {"contact02": "stulov", "contact07": "hysteresis", "contact12": "hysteresis"}


@pytest.mark.parametrize(
    ("scene", "laws"),
    [
        ("whole", {}),
        ("whole", LAWS),
        ("string", {}),
    ],
    ids=["plain", "felt", "string"],
)
def test_a_run_goes_on_from_a_saved_state_to_the_last_bit(scene: str, laws: dict[str, str]) -> None:
    action, choice = model.load_action("hirschkorn2004-regulated").with_laws(laws), model.load_scene(scene)
    time, force, _ = reference("forte")
    built = model.build_scene(choice.on(action), choice)
    through = model.Simulation(built, model.State(0.0, solve_rest(built), np.zeros(built.size)))
    through.advance(0.112, time, force)  # the hammer is on the string
    saved = through.state.copy()
    assert not saved.memory.size or np.ptp(saved.memory) > 0.1
    through.advance(0.3, time, force)
    again = model.Simulation(built, saved)
    again.advance(0.3, time, force)
    for name in ("angle_rad", "speed_rad_per_s", "memory", "step_s"):
        np.testing.assert_array_equal(getattr(again.state, name), getattr(through.state, name))


@pytest.mark.parametrize("past", [5e-10, 9e-10, -5e-10])
def test_output_time_that_rounding_puts_past_the_end_has_the_state_there(action: model.Action, past: float) -> None:
    time, force, _ = reference("forte")
    rest = model.rest_state(action).angle_rad
    run = model.Simulation(model.build_scene(action), model.State(0.0, rest, np.zeros(5)))
    angles, speeds = run.advance(0.11, time, force, output_time_s=np.array([-past, 0.1, 0.11 + past]))
    np.testing.assert_allclose(angles[-1], run.state.angle_rad, atol=1e-8)
    np.testing.assert_allclose(speeds[-1], run.state.speed_rad_per_s, atol=1e-5)
    assert np.all(np.isfinite(angles)) and np.all(np.isfinite(speeds))
    # a run that has already got there
    angles, speeds = run.advance(0.11 - 5e-10, time, force, output_time_s=np.array([0.11 + 4e-10]))
    np.testing.assert_array_equal(angles[0], run.state.angle_rad)


@pytest.mark.parametrize("block", [0.02, 0.00317])
def test_blocks_change_the_answer_by_less_than_the_tolerance(action: model.Action, block: float) -> None:
    time, force, _ = reference("forte")
    whole = model.simulate(action, time, force)
    scene = model.build_scene(action)
    run = model.Simulation(scene, model.State(0.0, model.rest_state(action).angle_rad, np.zeros(5)))
    angles = []
    edges = np.append(np.arange(0, time[-1], block), time[-1])
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        inside = time[(time >= a) & (time < b)] if b < time[-1] else time[time >= a]
        angles.append(run.advance(b, time, force, output_time_s=inside)[0])
    assert np.abs(np.concatenate(angles) - whole.angle_rad).max() < 1e-5


def test_held_input_jumps_at_its_points(action: model.Action) -> None:
    """A staircase force equals a linear table with almost vertical risers."""
    points = np.array([0.0, 0.01, 0.02, 0.03])
    values = np.array([0.0, 2.0, 5.0, 5.0])
    scene = model.build_scene(action)
    rest = model.rest_state(action).angle_rad
    held = model.Simulation(scene, model.State(0.0, rest, np.zeros(5)), tolerance=1e-9)
    held.advance(0.03, points, values, held=True)
    e = 1e-9
    steep_t = np.array([0, 0.01 - e, 0.01, 0.02 - e, 0.02, 0.03])
    steep = model.simulate(action, steep_t, [0, 0, 2, 2, 5, 5], tolerance=1e-9)
    np.testing.assert_allclose(held.state.angle_rad, steep.angle_rad[-1], atol=2e-7)


def test_action_at_rest_stays_at_rest(action: model.Action) -> None:
    solution = model.simulate(action, [0.0, 1.0], [0.0, 0.0], output_time_s=np.linspace(0, 1, 11))
    assert np.abs(solution.angle_rad - solution.angle_rad[0]).max() < 1e-12
    assert solution.counters["n_steps"] == 0
    assert solution.counters["time_at_rest"] == 1.0


def test_an_action_comes_to_rest_after_a_blow_and_a_creeping_hammer_is_not_at_rest(action: model.Action) -> None:
    time, force, _ = reference("forte")
    longer = model.simulate(action, np.append(time, 61.0), np.append(force, 0.0), output_time_s=[0.6, 60.0, 61.0])
    assert longer.counters["time_at_rest"] > 59.0
    settled = model.rest_state(action).angle_rad
    np.testing.assert_allclose(longer.angle_rad[-1], longer.angle_rad[-2], atol=1e-12)
    # friction lets the action rest off the frictionless balance, but not by much
    np.testing.assert_allclose(longer.angle_rad[-1], settled, atol=2e-4)
    # held in check by friction the hammer creeps: a constant force, yet no rest
    early = time < 0.2
    hold = ([*time[early], 3.0], [*force[early], 10.0])
    held = model.simulate(action, *hold, output_time_s=[0.3, 3.0])
    fine = model.simulate(action, *hold, output_time_s=[0.3, 3.0], tolerance=1e-9)
    assert np.abs(held.angle_rad - fine.angle_rad).max() < 1e-5
    assert np.abs(held.angle_rad[1] - held.angle_rad[0]).max() > 1e-4
    assert held.counters["time_at_rest"] < 0.2


def test_rest_ends_with_the_next_change_of_the_input(action: model.Action) -> None:
    table = np.array([[0, 0], [5, 0], [5.05, 6], [5.2, 6], [5.25, 0], [6, 0]], float)
    at = np.linspace(5.0, 5.6, 301)
    waited = model.simulate(action, table[:, 0], table[:, 1], output_time_s=at)
    direct = model.simulate(action, table[1:, 0], table[1:, 1], output_time_s=at, tolerance=1e-8)
    assert np.abs(waited.angle_rad - direct.angle_rad).max() < 1e-5
    assert waited.counters["time_at_rest"] > 4.99


@pytest.mark.parametrize(
    ("time", "force", "words"),
    [
        ([0, 1, 1], [0, 0, 0], "row 3: time 1 s does not follow 1 s"),
        ([0, 1, 0.5], [0, 0, 0], "must increase"),
        ([], [], "found 0 rows"),
        ([0.0], [0.0], "found 1 rows"),
        ([0, 1], [0, np.nan], "row 2: force_n found nan"),
        ([0, np.inf], [0, 0], "row 2: time_s found inf"),
        ([0, 1], [0, 5000], "allowed finite numbers up to 1000"),
        ([[0, 1]], [[0, 1]], "two equal columns"),
    ],
)
def test_bad_force_tables_are_refused(action: model.Action, time: list, force: list, words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        model.simulate(action, time, force)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("t,F\n0,0\n1,1\n", "columns found t,F; allowed time_s,force_n"),
        ("time_s,force_n\n0,zero\n1,1\n", "row 1: force_n found 'zero', allowed a number"),
        ("time_s,force_n\n0,0,0\n1,1\n", "row 1"),
        ("time_s,force_n\n0,0\n0,1\n", "row 2: time 0 s does not follow"),
        ("time_s,force_n\n0,nan\n1,1\n", "row 1: force_n found nan"),
    ],
)
def test_bad_force_files_are_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "blow.csv"
    path.write_text(text)
    with pytest.raises(model.InputError, match=words) as caught:
        model.read_force_table(path)
    assert "blow.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_columns_of_a_force_file_may_come_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "blow.csv"
    path.write_text("force_n,time_s\n3,0\n4,0.5\n")
    time, force = model.read_force_table(path)
    assert time.tolist() == [0, 0.5] and force.tolist() == [3, 4]


def test_bad_tolerance_and_output_times(action: model.Action) -> None:
    with pytest.raises(model.InputError, match="tolerance"):
        model.simulate(action, [0, 1], [0, 0], tolerance=0)
    with pytest.raises(model.InputError, match="within the table"):
        model.simulate(action, [0, 1], [0, 0], output_time_s=[0, 2])
    with pytest.raises(model.InputError, match="output rate"):
        model.output_times(0, 1, -5)
    with pytest.raises(model.InputError, match="allowed rodas4p, rodas5p"):
        model.simulate(action, [0, 1], [0, 0], method="euler")


def test_an_error_that_grows_is_said(action: model.Action) -> None:
    """White noise of 5 N: the estimate is near the true error, which is far above the request; a blow keeps it."""
    rest = model.rest_state(action)
    at = np.arange(0.0, 0.4, 2e-4)
    noise = np.random.default_rng(5).normal(0.0, 5.0, len(at))
    keywords = {"initial": rest, "output_time_s": np.linspace(0.0, 0.39, 200)}
    plain = model.simulate(action, at, noise, **keywords)
    said = model.simulate(action, at, noise, estimate_error=True, **keywords)
    np.testing.assert_array_equal(plain.angle_rad, said.angle_rad)
    exact = model.simulate(action, at, noise, tolerance=1e-11, method="rodas5p", **keywords)
    error = float(np.abs(said.angle_rad - exact.angle_rad).max())
    assert plain.error_rad is None and not plain.misses_tolerance
    assert error > 1e-4 and said.misses_tolerance and said.error_rad is not None
    assert error / 10.0 < said.error_rad < 10.0 * error
    time, force, rows = reference("forte")
    blow = model.simulate(action, time, force, output_time_s=rows[:, 0], estimate_error=True)
    error = float(np.abs(blow.angle_rad - rows[:, 1:6]).max())
    assert blow.error_rad == pytest.approx(error, rel=1.0) and not blow.misses_tolerance


def test_the_run_that_an_error_is_estimated_with_is_bound_ten_times_tighter_in_all_ways(action: model.Action) -> None:
    """Friction with a tiny threshold bounds errors of speeds by itself: both runs made the same error, unseen."""
    sharp = action.with_values({"friction_threshold.v_t": 1e-5})
    scene = model.build_scene(sharp)
    state = model.State(0.0, scene.start.copy(), np.zeros(5))
    run = ForceDrivenRun(scene, *model.force_table("forte"), np.array([0.5]), 1e-5, "rodas4p")
    own, judge = (run.plan_run(state, companion=which)[1].limits for which in (False, True))
    assert own.speed < 1e-5  # bound by the threshold
    assert judge.speed <= 0.1 * own.speed and judge.angle <= 0.1 * own.angle


def test_an_error_in_doubt_is_judged_by_a_second_companion(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where errors grow, one companion may go wrong as the run does: 3 of 900 random actions were off unseen."""
    scene = model.build_scene(action)
    state = model.State(0.0, model.rest_state(action).angle_rad, np.zeros(5))
    run = ForceDrivenRun(scene, *model.force_table("forte"), np.array([0.12]), 1e-5, "rodas4p", estimate_error=True)
    for found, asked, said in (
        ([0.5e-5], 1, 0.5e-5),
        ([3e-5, 2e-4], 2, 2e-4),
        ([3e-5, 1e-5], 2, 3e-5),
        ([2e-4], 1, 2e-4),
    ):
        answers = iter(found)
        calls: list[float] = []

        def difference(*_: object) -> float:
            calls.append(next(answers))  # noqa: B023
            return calls[-1]  # noqa: B023

        monkeypatch.setattr(ForceDrivenRun, "largest_difference", difference)
        assert run.simulate_from(state).error_rad == said and len(calls) == asked
    assert run.companion(state, 0.01).tolerance == pytest.approx(1e-7)
