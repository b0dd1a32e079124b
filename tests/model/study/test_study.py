"""Studies: what is read off a blow, on made-up motions of known answer; variants."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import force_table
from model.files.force_library import KNOTS
from model.observables import hammer_height_from_angle
from model.study import Variant, compare, measure_blow

TIME = np.arange(0, 0.7, 2e-4)
FORCE = np.interp(TIME, [0.0, 0.1, 0.105, 0.4, 0.45], [0.0, 10.0, 10.0, 10.0, 0.0])


def angle_at(action: model.Action, height: np.ndarray) -> np.ndarray:
    """Hammer angles at which the hammer is ``height`` below the string."""
    angle = np.linspace(-0.15, 0.35, 20001)
    reached = hammer_height_from_angle(action, angle)
    return np.interp(height, reached, angle)


def made_up(action: model.Action, height: np.ndarray, check: np.ndarray, lever: np.ndarray) -> model.Solution:
    """A solution whose hammer follows ``height`` (m,), with forces of back check and lever (m,)."""
    angle, normal = np.zeros((len(TIME), 5)), np.zeros((len(TIME), 13))
    angle[:, 4] = angle_at(action, height)
    normal[:, 3], normal[:, 9] = check, lever
    speed = np.gradient(angle, TIME, axis=0)
    names = tuple(f"contact{i:02d}" for i in range(1, 14))
    return model.Solution(model.BODIES, TIME, angle, speed, names, normal, np.zeros_like(normal))


def test_a_made_up_blow_is_read_as_it_was_made(action: model.Action) -> None:
    """Rises at 2 m/s, meets the string at 0.1205 s, is caught at 15 mm, swings by 0.4 mm, knocks on the lever twice."""
    height = np.interp(TIME, [0.0, 0.0965, 0.1215, 0.14, 0.5, 0.55], [0.048, 0.048, -0.002, 0.015, 0.015, 0.048])
    height += np.where((TIME > 0.2) & (TIME < 0.45), 0.2e-3 * np.sin(2 * np.pi * 50 * TIME), 0.0)
    check = np.where((TIME > 0.14) & (TIME < 0.45), 5.0, 0.0)
    lever = np.where(((TIME > 0.15) & (TIME < 0.16)) | ((TIME > 0.25) & (TIME < 0.3)), 1.0, 0.0)
    m = measure_blow(action, made_up(action, height, check, lever), FORCE)
    assert m.strike_s == pytest.approx(0.1205, abs=2e-5)
    assert m.strike_m_per_s == pytest.approx(2.0, rel=0.01)
    assert (m.strikes, m.held, m.lever_bounces) == (1, True, 2)
    assert m.release_s == pytest.approx(0.4025, abs=3e-4)  # 5 % down a ramp of 0.05 s
    assert m.hold_m == pytest.approx(0.015, abs=1e-6) and m.hold_moved_m == pytest.approx(0.4e-3, rel=0.02)


@pytest.mark.parametrize("case", ["off the check", "moves", "never struck"])
def test_what_is_not_held(action: model.Action, case: str) -> None:
    height = np.interp(TIME, [0.0, 0.0965, 0.1215, 0.14, 0.5, 0.55], [0.048, 0.048, -0.002, 0.015, 0.015, 0.048])
    check = np.where(TIME > 0.14, 5.0, 0.0)
    if case == "off the check":
        check[:] = 0.0
    elif case == "moves":
        height += np.where(TIME > 0.2, 0.8e-3 * np.sin(2 * np.pi * 50 * TIME), 0.0)
    else:
        height, check = np.full_like(TIME, 0.048), np.zeros_like(TIME)
    m = measure_blow(action, made_up(action, height, check, np.zeros_like(TIME)), FORCE)
    assert not m.held
    assert m.strikes == (0 if case == "never struck" else 1)
    assert np.isnan(m.strike_s) == (case == "never struck")


def test_variants_are_what_simulating_each_alone_gives(action: model.Action) -> None:
    time, force = force_table("forte")
    study = compare(
        action, time, force, [Variant("dry", factors={"damping": 0.1}), Variant("heavy", {"hammer.mass": 0.013})]
    )
    assert [v.name for v in study.variants] == ["as given", "dry", "heavy"]
    alone = model.simulate(action.with_values({"hammer.mass": 0.013}), time, force, output_time_s=study.time_s)
    np.testing.assert_array_equal(study["heavy"][0].angle_rad, alone.angle_rad)
    rows = study.rows()
    assert rows[0]["hammer_rms_rad"] == 0.0 and rows[1]["hammer_largest_rad"] > 0.01
    away = study["dry"][0].angle_rad[:, 4] - study["as given"][0].angle_rad[:, 4]
    assert rows[1]["hammer_largest_rad"] == pytest.approx(np.abs(away).max())
    assert rows[2]["strike_m_per_s"] < rows[0]["strike_m_per_s"]


@pytest.mark.parametrize(
    ("variants", "words"),
    [
        ([Variant("a"), Variant("a")], "the name is given twice"),
        ([Variant("as given")], "'as given' is taken"),
        (
            [Variant("b", {"hammer.mas": 1.0})],
            "variant 'b': parameter hammer.mas: unknown path; did you mean hammer.mass",
        ),
    ],
)
def test_bad_variants_are_refused(action: model.Action, variants: list[Variant], words: str) -> None:
    with pytest.raises(model.InputError) as caught:
        compare(action, *force_table("forte"), variants)
    assert words in str(caught.value)


def test_force_tables_are_as_the_thesis_describes() -> None:
    time, force = force_table("thesis-forte")
    assert force[time <= 0.05].max() == 0.0 and force[time == 0.11][0] == 10.0
    assert 33.0 < force.max() <= 34.0 and np.all(force[(time > 0.12) & (time < 0.31)] == 10.0)
    time, force = force_table("piano")
    assert force[time < 0.16].max() <= 1.5
    for name in KNOTS:
        assert force_table(name)[0].shape == (3501,)
    with pytest.raises(model.InputError, match="allowed forte, thesis-forte"):
        force_table("mezzo")


def test_a_blow_without_contact_forces_is_refused(action: model.Action) -> None:
    blow = model.simulate(action, TIME[:10], FORCE[:10])
    with pytest.raises(model.InputError, match="found a solution without contact forces; simulate with"):
        measure_blow(action, blow, FORCE[:10])


def test_a_variant_that_never_strikes_has_no_strike(action: model.Action) -> None:
    study = compare(action, *force_table("piano"), [Variant("lead", {"hammer.mass": 0.05})])
    assert np.isnan(study["lead"][1].strike_s) and study["lead"][1].strikes == 0
    assert np.isfinite(study["as given"][1].strike_s)


def test_what_is_lost_is_the_sum_of_every_loss() -> None:
    audit = model.EnergyAudit(1000.0, 40.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
    assert (audit.loss, audit.residual) == (255.0, 705.0)
