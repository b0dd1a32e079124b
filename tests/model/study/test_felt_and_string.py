"""What another law of felt, or a string, changes in a blow with everything else equal."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import model
from model.study import effects_at_equal_loss, equal_loss, felt_law_effects, string_effects
from model.study.effects import PLAIN, blow_marks
from pianorig.commands.study import effect_lines, effect_rows

BLOW = model.force_table("forte")


@pytest.mark.slow  # python -m pytest -m slow tests/model/study
def test_a_group_of_felts_changes_its_law_and_nothing_else() -> None:
    action = model.load_action("hirschkorn2004-regulated")
    base, stulov, hysteresis = felt_law_effects(action, *BLOW, {"key front": ["contact02"]})
    assert (base.of, base.law, base.held) == ("all felts", "hunt-crossley", True)
    assert not any(base.u.values())
    for effect in (stulov, hysteresis):
        # the key lands when the hammer already flies: touch and strike stay, the check does not
        for name in ("free_flight_ms", "strike_m_per_s", "rebound", "down_n", "let_off_n"):
            assert effect.value[name] == pytest.approx(base.value[name], rel=1e-4), name
        assert abs(effect.value["check_mm"] - base.value["check_mm"]) > 0.05
        assert 0.05 < effect.u["check_mm"] < 5.0
    lines = effect_lines([base, stulov, hysteresis])
    assert len(lines) == 4 and "+-" in lines[2] and len({len(line.rsplit("  ", 1)[0]) for line in lines}) == 1
    assert effect_rows([stulov])[0]["u_check_mm"] == stulov.u["check_mm"]


def test_felts_are_studied_in_one_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """The press as well as the blow: the action by itself, whatever scene it carries."""
    action, weighed = model.load_action("hirschkorn2004-regulated"), list[model.Action]()
    monkeypatch.setattr(
        "model.study.effects.weigh", lambda a: weighed.append(a) or SimpleNamespace(down_n=1, let_off_n=2)
    )
    (carried,) = felt_law_effects(model.load_scene("giving-joints").on(action), *BLOW, {})
    assert [model.choice_of(a) for a in weighed] == [model.SceneChoice()]
    assert carried.value == felt_law_effects(action, *BLOW, {})[0].value


def test_a_blow_whose_table_ends_on_the_string_has_no_rebound() -> None:
    at = BLOW[0] < 0.1111
    found = blow_marks(model.load_action("hirschkorn2004-regulated"), (BLOW[0][at], BLOW[1][at]), PLAIN)
    assert 110.0 < found["strike_ms"] < 111.0 and np.isnan([found["contact_ms"], found["rebound"]]).all()


def test_a_string_takes_the_hammer_for_longer_than_the_bar() -> None:
    bar, string = string_effects(model.load_action("hirschkorn2004-regulated"), *BLOW)
    assert string.value["strike_m_per_s"] == pytest.approx(bar.value["strike_m_per_s"], rel=1e-5)  # up to there alike
    assert string.value["contact_ms"] > 2.0 * bar.value["contact_ms"]
    assert 0.01 < string.u["contact_ms"] < 0.5 and 0.001 < string.u["rebound"] < 0.1
    assert np.isnan(bar.value.get("down_n", np.nan))


@pytest.mark.parametrize("law", ["stulov", "hysteresis"])
def test_peak_and_loss_of_a_law_are_found_again(law: str) -> None:
    """Along a press in and out, with a rest and a second press: share and height that were put in come out."""
    action = model.load_action()
    time_s = np.linspace(0.0, 4e-3, 401)
    depth_m = 4e-4 * np.maximum(0.0, np.sin(2.0 * np.pi * time_s / 2.2e-3))
    curve = tuple(action[f"contact12.normal.{k}"] for k in "abc")
    path, second = equal_loss.SECOND[law], action[f"contact12.{equal_loss.SECOND[law]}"]
    press = equal_loss.Press(time_s, depth_m, 0.0, 0.0)
    felt = equal_loss._felt(law, (0.7 * curve[0], 0.7 * curve[1], 0.7 * curve[2]), 0.63, second)
    force = felt.response(press.time_s, press.depth_m).force_n
    loss = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(depth_m)))
    given = action.with_laws({"contact12": law})
    wanted = equal_loss.Press(time_s, depth_m, float(force.max()), loss)
    found = equal_loss._fit(action, given, "contact12", law, wanted)
    assert found[f"contact12.{equal_loss.SHARE[law]}"] == pytest.approx(0.63, abs=0.002), path
    assert found["contact12.normal.a"] == pytest.approx(0.7 * action["contact12.normal.a"], rel=0.01)


@pytest.mark.slow  # python -m pytest -m slow tests/model/study
def test_at_equal_loss_the_memory_of_the_hammers_felt_is_hardly_felt() -> None:
    """Peak and loss agree in the blow itself; the check, which another law moves by millimetres, hardly moves."""
    action = model.load_action("hirschkorn2004-regulated")
    base, stulov, hysteresis = effects_at_equal_loss(action, *BLOW, {"hammer": ["contact12"]})
    for effect in (stulov, hysteresis):
        assert effect.value["peak_n"] == pytest.approx(base.value["peak_n"], rel=0.01)
        assert effect.value["loss_mj"] == pytest.approx(base.value["loss_mj"], rel=0.01)
        assert effect.value["rebound"] == pytest.approx(base.value["rebound"], abs=0.01)
        assert abs(effect.value["check_mm"] - base.value["check_mm"]) < 0.1
        assert effect.u["share"] > 0.05  # from tau or eta, fitted again


def test_a_felt_that_is_switched_off_was_never_pressed() -> None:
    action = model.load_action("hirschkorn2004-regulated").with_values({"contact12": 0})
    at = BLOW[0] < 0.13
    moved = model.simulate(action, BLOW[0][at], BLOW[1][at], contact_forces=True)
    assert list(equal_loss.presses(action, moved, ["contact12", "contact02"])) == ["contact02"]


def test_numbers_of_a_law_that_is_set_aside_wait_for_it() -> None:
    """A tau that was set with its law had the whole study refused."""
    own = model.load_action().with_laws({"contact12": "stulov"}).with_values({"contact12.stulov.tau": 1e-4})
    plain, stulov = (
        equal_loss.with_usual_felts(own).with_laws({"contact12": law}) for law in ("hunt-crossley", "stulov")
    )
    numbers = [model.build_scene(action).vector for action in (model.load_action(), plain, own, stulov)]
    np.testing.assert_array_equal(numbers[0], numbers[1])
    np.testing.assert_array_equal(numbers[2], numbers[3])
