"""What another law of felt, or a string, changes in a blow with everything else equal."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.study import felt_law_effects, string_effects
from pianorig.workflows.model.study_felt_law import effect_lines, effect_rows

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


def test_a_string_takes_the_hammer_for_longer_than_the_bar() -> None:
    bar, string = string_effects(model.load_action("hirschkorn2004-regulated"), *BLOW)
    assert string.value["strike_m_per_s"] == pytest.approx(bar.value["strike_m_per_s"], rel=1e-5)  # up to there alike
    assert string.value["contact_ms"] > 2.0 * bar.value["contact_ms"]
    assert 0.01 < string.u["contact_ms"] < 0.5 and 0.001 < string.u["rebound"] < 0.1
    assert np.isnan(bar.value.get("down_n", np.nan))
