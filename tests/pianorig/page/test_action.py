"""The action to try out: the blow is the model's own, sliders stay within what is allowed, the file reads back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from model.parameters.quantity import check_value
from pianorig.page.action import BLOWS, action_facts, blow_curves, changed_action, live_blow, slider_range, toml_of
from tests.pianorig.page.conftest import Page
from tests.pianorig.page.test_review import numbers

CHANGES = ["contact08.second.y=0.0651", "hammer.mass=0.009"]
NAME = "hirschkorn2004"
BLOW = "/api/action/hirschkorn2004/blow?blow=forte"


@pytest.fixture(scope="module")
def turned() -> model.Action:
    return changed_action("hirschkorn2004", [*CHANGES, "string.modes=20"], "string")


def test_the_blow_is_what_simulate_says_of_the_changed_action() -> None:
    found = live_blow(NAME, CHANGES, "forte")
    table = model.force_table("forte")
    same = model.load_action("hirschkorn2004", {"contact08.second.y": 0.0651, "hammer.mass": 0.009})
    wanted = model.simulate(same, *table, output_time_s=numbers(found["time_s"]).clip(0.0, 0.7))
    rest = model.rest_state(same).angle_rad
    for i, (body, sign) in enumerate((("key", -1), ("whippen", 1), ("jack", -1), ("repetition", -1), ("hammer", -1))):
        shown = numbers(found["channels"][body]["value"])
        np.testing.assert_allclose(shown, sign * np.degrees(wanted.angle_rad[:, i] - rest[i]), atol=0.01, err_msg=body)
    at_once = blow_curves(NAME, CHANGES, "forte")["values"]
    assert at_once == [channel["value"] for channel in found["channels"].values()]  # the same numbers before the rest
    drawn = numbers(found["drawing"]["pose"])[:, 0, 2]
    times = numbers(found["drawing"]["time_s"])
    key = -np.interp(times, numbers(found["time_s"]), numbers(found["channels"]["key"]["value"]))
    np.testing.assert_allclose(np.degrees(drawn - drawn[0]), key - key[0], atol=0.01)


def test_events_follow_what_was_turned() -> None:
    def values(*changes: str) -> dict[str, Any]:
        return {event["name"]: event["value"] for event in live_blow(NAME, changes, "forte")["events"]}

    given = values()
    assert values(*CHANGES)["hammer_speed"] != pytest.approx(given["hammer_speed"], rel=1e-3)
    # a heavier hammer is slower at the string
    heavy = values("hammer.mass=0.012")
    light = values("hammer.mass=0.007")
    assert heavy["hammer_speed"] < given["hammer_speed"] < light["hammer_speed"]
    assert given["second_strike"] is None  # what does not happen has no value


def test_a_scene_is_that_of_simulate_and_its_numbers_can_be_turned() -> None:
    own = "[string]\nmodes = 20\n[contact02]\nlaw = 'hysteresis'\n"
    found = live_blow(NAME, ["contact02.hysteresis.beta=0.4"], "forte", own)
    action = changed_action(NAME, ["contact02.hysteresis.beta=0.4"], own)
    assert action["string.modes"] == 20.0 and action.law("contact02") == "hysteresis"
    wanted = model.simulate(action, *model.force_table("forte"), output_time_s=numbers(found["time_s"]).clip(0.0, 0.7))
    turned = -np.degrees(wanted.angle_rad[:, 4] - model.rest_state(action).angle_rad[4])
    np.testing.assert_allclose(numbers(found["channels"]["hammer"]["value"]), turned, atol=0.01)
    added = {one["path"]: one for one in action_facts(NAME, own)["parameters"] if one["of_scene"]}
    assert {path.split(".")[0] for path in added} == {"string", "contact02"}
    assert added["string.modes"]["value"] == 20.0 and added["string.modes"]["high"] == 100.0
    alone = live_blow(NAME, [], "piano", "key-whippen")
    assert list(alone["channels"]) == ["key", "whippen"] and alone["events"] == []


def test_every_slider_stays_within_what_is_allowed() -> None:
    for name in ("hirschkorn2004", "hirschkorn2004-regulated"):
        facts = action_facts(name)
        assert [screw["target"] for screw in facts["screws"]] == [t.name for t in model.regulation.TARGETS] + [""]
        given = model.load_action(name)
        for one in [*facts["parameters"], *facts["screws"]]:
            assert one["low"] < one["high"]
            for end in (one["low"], one["high"]):
                check_value(one["path"], end, "slider")
        for one in [*facts["parameters"][::9], *facts["screws"]]:  # shapes that hang together are checked, too
            given.with_values({one["path"]: one["low"]})
    values = {one["path"]: one["value"] for one in facts["parameters"]}
    assert all(screw["low"] <= values[screw["path"]] <= screw["high"] for screw in facts["screws"])
    assert slider_range("contact01.normal.a", 0.0, "N/m") == (0.0, 0.005)


def test_the_file_reads_back_to_the_same_numbers(turned: model.Action, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(toml_of(turned))
    again = model.load_action(path)
    assert again.content() == turned.content() and again.scene == turned.scene != {}
    assert "hammer.mass = 0.009 kg" in path.read_text() and "by the user" in again.quantities["hammer.mass"].source


def test_the_page_asks_and_gets(shown: Page) -> None:
    names = shown.ask("/api/actions").json
    assert "hirschkorn2004-regulated" in names["actions"] and names["blows"] == list(BLOWS)
    plain, heavy = (shown.ask(BLOW + more) for more in ("", "&set=hammer.mass=0.012"))
    assert plain.status == heavy.status == 200
    peaks = [numbers(answer.json["channels"]["hammer"]["value"]) for answer in (plain, heavy)]
    assert np.abs(peaks[0] - peaks[1]).max() > 0.1
    moving = shown.ask("/api/action/hirschkorn2004/animation?blow=piano&set=hammer.mass=0.012").json["text"]
    assert "<title>hirschkorn2004, hammer.mass=0.012</title>" in moving and '"start_s"' in moving
    text = shown.ask("/api/action/hirschkorn2004/file?set=hammer.mass=0.012").json["text"]
    assert "hammer.mass = 0.012 kg" in text


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("/api/action/..%2f..%2fetc/blow", "allowed hirschkorn2004"),
        ("/api/action/mine.toml", "allowed hirschkorn2004"),
        (f"{BLOW}&set=hammer.mass=-1", "hammer.mass"),
        (f"{BLOW}&set=hammer.mass=nan", "hammer.mass"),
        (f"{BLOW}&set=hammer.mass=1e400", "hammer.mass"),
        (f"{BLOW}&set=hammer.mass=x", "path=value"),
        (f"{BLOW}&set=hammer.weight=1", "unknown path"),
        (f"{BLOW}&set=x", "path=value"),
        ("/api/action/hirschkorn2004/curves?blow=forte&set=hammer.mass=-1", "hammer.mass"),
        ("/api/action/hirschkorn2004/blow?blow=../forte.csv", "forte"),
        (f"{BLOW}&scene=mine.toml", "allowed whole"),
        (f"{BLOW}&scene=motor-arm", "driven by torque_nm"),
        (f"{BLOW}&scene=x%3D", "not valid TOML"),
        (f"{BLOW}&scene=%5Bstring%5D%0Amode%3D30", "string.mode"),
        (f"{BLOW}&set=string.modes=30", "the scene has no string"),
        ("/api/action/hirschkorn2004/touch?scene=key", "allowed one with all bodies"),
        ("/api/action/hirschkorn2004/step?scene=key&target=let_off&turn_m=1e-4", "allowed one with all bodies"),
        ("/api/action/hirschkorn2004/file", "nothing was changed"),
        ("/api/action/hirschkorn2004/step?target=nothing&turn_m=1e-4", "let_off"),
        ("/api/action/hirschkorn2004/step?target=let_off&turn_m=nan", "turn_m"),
        ("/api/action/hirschkorn2004/step?target=let_off&turn_m=0.1", "allowed up to 5 mm"),
        (BLOW + "&set=hammer.mass=0.01" * 201, "201 changes"),
    ],
)
def test_what_cannot_be_tried_is_refused_in_one_line(shown: Page, address: str, words: str) -> None:
    answer = shown.ask(address)
    assert answer.status == 400 and words in answer.json["error"] and "\n" not in answer.json["error"]


def test_a_technicians_step_moves_its_own_target_most(shown: Page) -> None:
    asked = "/api/action/hirschkorn2004-regulated/step?target=let_off&turn_m=1e-4"
    found = shown.ask(asked).json
    change = {row["target"]: row["after_m"] - row["before_m"] for row in found["rows"]}
    assert found["screw"] == "button" and max(change, key=lambda name: abs(change[name])) == "let_off"
    assert change["let_off"] == pytest.approx(-5.0 * 1e-4, rel=0.5)  # as `SCREWS` states it
    assert all(abs(change[name]) < 1e-9 for name in ("dip", "hammer_height", "jack", "repetition"))


def test_the_touch_curve_is_that_of_weigh(shown: Page) -> None:
    found = shown.ask("/api/action/hirschkorn2004/touch").json
    wanted = model.touch.weigh(model.load_action("hirschkorn2004"))
    assert found["weights"]["down weight"] == pytest.approx(wanted.down_n, rel=1e-9)
    dip, force = numbers(found["press"]["dip_m"]), numbers(found["press"]["force_n"])
    assert dip.max() == pytest.approx(wanted.dip_m, rel=0.05) and force.max() > wanted.down_n
