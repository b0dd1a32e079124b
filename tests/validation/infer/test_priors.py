"""Names, groups and priors of what can be identified."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import model
from validation import ValidationInputError
from validation.infer.unknowns import LAW_U, expand, group_members, parameter_of, single_names, unknowns

ACTION = model.load_action()
NAMES = single_names(ACTION)


def test_groups_and_felts_stand_for_their_members() -> None:
    assert expand(ACTION, ["friction"]) == [f"contact{n}.friction.A" for n in ("01", "04", "07", "10")]
    assert expand(ACTION, ["felt:contact02"]) == ["contact02", "contact02.normal.D"]
    assert expand(ACTION, ["contact04.friction", "contact04.friction.A"]) == ["contact04.friction.A"]
    assert len(group_members(ACTION, "joint_friction")) == 5
    contacts = [f"contact{n:02d}" for n in range(1, 14)]
    assert group_members(ACTION, "damping") == [f"{contact}.normal.D" for contact in contacts]
    assert group_members(ACTION, "stiffness") == contacts
    assert group_members(ACTION, "springs") == ["jack_spring.torque", "repetition_spring.stiffness"]
    assert expand(ACTION, ["jack_spring"]) == ["jack_spring.torque"]


def test_a_law_known_to_printed_digits_gets_a_wide_prior_and_says_so() -> None:
    p = parameter_of(ACTION, "hammer.joint_friction.A", NAMES["hammer.joint_friction.A"])
    assert p is not None and p.factor and p.u == LAW_U and "printed digits" in p.basis
    assert p.values(ACTION, 1.0)["hammer.joint_friction.A"] == pytest.approx(0.00101 * math.exp(LAW_U))
    mass = parameter_of(ACTION, "hammer.mass", NAMES["hammer.mass"])
    assert mass is not None and not mass.factor and mass.u == ACTION.quantities["hammer.mass"].u


def test_a_stiffness_moves_all_three_coefficients_by_one_factor() -> None:
    p = parameter_of(ACTION, "contact02", NAMES["contact02"])
    assert p is not None
    moved = p.values(ACTION, 0.5)
    ratios = {moved[f"contact02.normal.{k}"] / ACTION[f"contact02.normal.{k}"] for k in "abc"}
    assert max(ratios) - min(ratios) < 1e-12 and p.physical(ACTION, 0.5) == pytest.approx(ratios.pop())


def test_slope_is_the_derivative_of_the_values() -> None:
    for name in ("contact02", "hammer.mass"):
        p = parameter_of(ACTION, name, NAMES[name])
        assert p is not None
        up, down = p.values(ACTION, 0.3 + 1e-5), p.values(ACTION, 0.3 - 1e-5)
        for path, slope in p.slope(ACTION, 0.3).items():
            assert slope == pytest.approx((up[path] - down[path]) / 2e-5, rel=1e-6)


def test_all_that_is_uncertain_takes_part_unless_fixed() -> None:
    wide = unknowns(ACTION, ["friction"])
    assert {"key.joint_friction.A", "contact02", "jack_spring.torque"} <= {p.name for p in wide.beside}
    assert "hammer.mass" in {p.name for p in wide.small}
    assert all(p.u > 0 for p in wide.moved)
    alone = unknowns(ACTION, ["friction"], ["*"])
    assert not alone.beside and not alone.small and len(alone.asked) == 4


def test_priors_given_win_and_must_be_positive() -> None:
    given = unknowns(ACTION, ["hammer.mass"], ["*"], {"hammer.mass": 1e-4}).asked[0]
    assert given.u == 1e-4 and given.basis == "given"
    with pytest.raises(ValidationInputError, match="allowed above 0"):
        unknowns(ACTION, ["hammer.mass"], ["*"], {"hammer.mass": 0.0})
    with pytest.raises(ValidationInputError, match="allowed in one of the two"):
        unknowns(ACTION, ["hammer.mass"], ["hammer.mass"])
    certain = replace(ACTION.quantities["hammer.mass"], u=0.0)
    known = replace(ACTION, quantities={**ACTION.quantities, "hammer.mass": certain})
    with pytest.raises(ValidationInputError, match="has no prior"):
        unknowns(known, ["hammer.mass"])


def test_felt_whose_first_coefficient_is_zero_takes_its_prior_from_one_that_is_not() -> None:
    lifting = replace(ACTION, scene={"effects": ("balance_rail",)})
    washer = parameter_of(lifting, "balance_rail", single_names(lifting)["balance_rail"])
    c = model.quantities_of(lifting)["balance_rail.normal.c"]
    assert washer is not None and washer.factor
    assert washer.u == pytest.approx(math.sqrt(math.log1p((c.u / c.value) ** 2)))
    assert washer.values(lifting, 1.0)["balance_rail.normal.a"] == 0.0
    assert "balance_rail" not in single_names(lifting.with_values({"balance_rail.normal.c": 0.0}))
