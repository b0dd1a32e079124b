"""Models of ``validate --action`` with their own changes, and what is refused."""

from __future__ import annotations

import pytest

import model
from pianorig.console.overrides import load_changed, load_model, read_variant, split_model
from pianorig.errors import CommandInputError
from validation.pipeline.compare_sessions import distinct_models


def test_a_model_takes_its_own_changes_beside_those_of_all():
    plain = load_model("hirschkorn2004", ["hammer.mass=0.012"])
    own = load_model("hirschkorn2004: --set contact04.friction.A=0.3 --scale damping=0.5", ["hammer.mass=0.012"])
    assert plain["hammer.mass"] == own["hammer.mass"] == 0.012
    assert own["contact04.friction.A"] == 0.3 != plain["contact04.friction.A"]
    assert own.name == "hirschkorn2004 (contact04.friction.A=0.3, damping × 0.5)"
    printed = model.load_action("hirschkorn2004")
    scaled = {path for path in printed.quantities if own[path] == 0.5 * printed[path] != 0}
    assert len(scaled) >= 10 and scaled == {path for path in printed.quantities if own[path] != plain[path]} - {
        "contact04.friction.A"
    }
    # the model's own value goes before that of all
    assert load_model("hirschkorn2004: --set hammer.mass=0.013", ["hammer.mass=0.012"])["hammer.mass"] == 0.013


def test_printed_against_printed_with_one_change_needs_no_file():
    pair = distinct_models([load_model(t) for t in ("hirschkorn2004", "hirschkorn2004: --set hammer.mass=0.012")])
    assert [a.name for a in pair] == ["hirschkorn2004", "hirschkorn2004 (hammer.mass=0.012)"]


def test_a_law_of_felt_is_set_with_its_numbers():
    """Printed against printed with another felt under the hammer; the law of all goes before that of none."""
    own = load_model("hirschkorn2004: --set contact12.hysteresis.beta=0.4 --set contact12.law=hysteresis")
    assert own.law("contact12") == "hysteresis" and own["contact12.hysteresis.beta"] == 0.4
    assert own.name == "hirschkorn2004 (contact12.law=hysteresis, contact12.hysteresis.beta=0.4)"
    every = load_model("hirschkorn2004", ["contact02.law=stulov", "hammer.mass=0.012"])
    assert every.law("contact02") == "stulov" and every.name == "hirschkorn2004 (contact02.law=stulov)"
    assert (
        load_changed("hirschkorn2004", ["contact02.law=stulov", "contact02.stulov.tau=1e-4"]).law("contact02")
        == "stulov"
    )
    with pytest.raises(CommandInputError, match="--variant felt: found a law of felt .contact02., allowed numbers"):
        read_variant("felt: --set contact02.law=stulov")


@pytest.mark.parametrize(
    "text, said",
    [
        ("hirschkorn2004: --set hammer.mass", "--set 'hammer.mass': allowed path=value"),
        ("hirschkorn2004: --set hammer.mass=heavy", "value found 'heavy', allowed a number"),
        ("hirschkorn2004: --weight hammer.mass=1", "--action hirschkorn2004: found '--weight'"),
        ("hirschkorn2004: --set hammer.mass=1 --set hammer.mass=2", "given twice"),
        ("hirschkorn2004: --set contact12.law=felt", "contact12.law: found 'felt', allowed hunt-crossley, stulov"),
        ("hirschkorn2004: --set hammer.law=stulov", "found 'hammer', allowed contact01 to contact13"),
        ("hirschkorn2004: --set contact12.law=stulov --set contact12.law=stulov", "contact12.law: given twice"),
    ],
)
def test_what_is_not_a_change_is_refused_in_one_line(text, said):
    with pytest.raises((CommandInputError, model.InputError)) as caught:
        load_model(text)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_path_of_windows_is_no_variant():
    assert split_model(r"C:\\actions\\mine.toml") == (r"C:\\actions\\mine.toml", "")
    assert split_model(r"C:\\mine.toml: --set hammer.mass=0.012") == (r"C:\\mine.toml", "--set hammer.mass=0.012")


def test_a_chosen_scene_is_in_the_name_of_a_report_s_model():
    alone = load_model("hirschkorn2004", scene="string")
    assert alone.name == "hirschkorn2004 (scene string)"
    assert load_model("hirschkorn2004: --set hammer.mass=0.01", scene="string").name == (
        "hirschkorn2004 (scene string, hammer.mass=0.01)"
    )
    assert load_model("hirschkorn2004").name == "hirschkorn2004"


def test_a_d_that_the_felts_law_has_not_is_said_to_change_nothing(recwarn):
    said = "contact02.normal.D: changes nothing, the law of this felt (stulov) has no D"
    for settings, scale in ((["contact02.normal.D=5"], []), ([], ["contact02.normal.D=2"])):
        with pytest.warns(UserWarning) as told:
            load_changed("hirschkorn2004", ["contact02.law=stulov", *settings], scale)
        assert [str(one.message) for one in told] == [said]
    load_changed("hirschkorn2004", ["contact02.law=stulov", "contact01.normal.D=5", "contact02.normal.a=1e9"])
    assert not list(recwarn)
