"""What a trial has of its own moves that trial alone, and as far as the same in all trials or its columns say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import model
from validation.conventions import Array
from validation.infer.blocks import make_blocks, residuals
from validation.infer.response import ModelResponse, Own, Response, make_nothing_own, remove_own
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import unknowns

EXAMPLE = Path(__file__).parents[4] / "sessions" / "example_forte"
START = model.load_action()
FREE = unknowns(START, ["hammer.joint_friction", "contact02"], ["*"])
P = len(FREE.moved)
HELD = ("contact01.friction.A", "contact04", "contact07.friction.A", "key.joint_friction.A")
EVERY = (*FREE.moved, *(p for p in FREE.held if p.name in HELD))  # of all that are held, some of each kind
AT = np.array([0.3, -0.2, *np.zeros(P - 2)])


@pytest.fixture(scope="module", params=[False, True], ids=["by force", "by key"])
def response(request: pytest.FixtureRequest) -> Response:
    """Two strokes, of few phases."""
    options = IdentifyOptions(phases=20, motion_driven=request.param)
    trials = collect([EXAMPLE], START, options).fitted[:2]
    found = ModelResponse(START, EVERY, trials, 1e-8)
    found.observed = trials  # type: ignore[attr-defined]
    return found


@pytest.fixture(scope="module")
def drive(response: Response) -> list[Array]:
    """What drives each stroke, where it is: half the runs of this file."""
    return response.jacobian(AT, (), driven=True)


def own(laws: dict[int, float], drive: Array | None = None) -> list[Own]:
    """The second trial has this of its own, the first nothing."""
    moved = np.zeros(len(EVERY))
    moved[list(laws)] = list(laws.values())
    weights = np.zeros(0) if drive is None else drive
    return [Own(np.zeros(len(EVERY)), 0 * weights), Own(moved, weights)]


def curves(response: Response, z: Array, of: Sequence[Own] | None = None) -> list[Array]:
    (found,) = response.curves([z], None if of is None else [of])
    assert found is not None
    return found


def test_laws_of_one_trial_move_it_alone(response: Response) -> None:
    held = next(j for j, p in enumerate(EVERY) if p.name.startswith("contact07.friction"))
    assert held >= P
    here = curves(response, AT)
    there = curves(response, AT, own({0: 0.4, held: 0.5}))
    np.testing.assert_array_equal(there[0], here[0])
    full = np.concatenate([AT, np.zeros(len(EVERY) - P)])
    full[[0, held]] += [0.4, 0.5]
    np.testing.assert_allclose(there[1], curves(response, full)[1], atol=1e-12)
    assert np.abs(there[1] - here[1]).max() > 1e-5


def test_derivatives_are_taken_where_each_trial_is(response: Response) -> None:
    first, second = response.jacobian(AT, [0, 1], own({1: 0.6}))
    moved = AT + 0.6 * (np.arange(P) == 1)
    np.testing.assert_allclose(first, response.jacobian(AT, [0, 1])[0], atol=1e-9)
    np.testing.assert_allclose(second, response.jacobian(moved, [0, 1])[1], atol=1e-9)


def test_what_drives_a_trial_moves_it_as_its_columns_say(response: Response, drive: list[Array]) -> None:
    columns = drive[1]
    weights = 0.1 * np.random.default_rng(5).standard_normal(columns.shape[2])
    here, there = curves(response, AT), curves(response, AT, own({}, weights))
    np.testing.assert_array_equal(there[0], here[0])
    rise = slice(0, 12)  # later contacts open and close: columns have kinks
    said, moved = (columns @ weights)[rise], (there[1] - here[1])[rise]
    assert np.sqrt(np.mean((moved - said) ** 2)) < 0.1 * np.sqrt(np.mean(said**2))


def test_the_linear_model_takes_out_what_it_put_in(response: Response, drive: list[Array]) -> None:
    trials = response.observed  # type: ignore[attr-defined]
    every = response.jacobian(AT, range(len(EVERY)))
    laws = np.array([p.factor for p in FREE.moved])
    blocks = make_blocks(trials, [j[:, :, :P] for j in every], drive, laws, [j[:, :, P:] for j in every])
    alike = residuals(trials, curves(response, AT))
    nothing = remove_own(blocks, alike, make_nothing_own(blocks))
    for a, b in zip(nothing, alike, strict=True):
        np.testing.assert_array_equal(a, b)
    small = own({0: 1e-3}, np.zeros(blocks[0].driven))
    found = remove_own(blocks, residuals(trials, curves(response, AT, small)), small)
    assert np.abs(found[1] - alike[1]).max() < 2e-3 * np.abs(1e-3 * blocks[1].moved[:, 0]).max() + 5e-8


def test_half_way_and_how_far() -> None:
    a, b = Own(np.zeros(3), np.zeros(2)), Own(np.array([0.2, 0.0, 9.0]), np.array([1.0, 1.0]))
    half = a.towards(b, 0.5)
    np.testing.assert_allclose([*half.laws, *half.drive], [0.1, 0.0, 4.5, 0.5, 0.5])
    # the third is no law: it has no scatter to be told by
    assert a.apart(b, np.array([0.1, 0.1, 0.0])) == pytest.approx(np.sqrt((2.0**2 + 1.0 + 1.0) / 4))
