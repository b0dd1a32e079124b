"""Trials that the measured key drives: what the model answers, its derivatives, and errors of the key's encoder."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import model
from rig.session.force_correction import ForceChannel, Quiet
from tests.validation.infer import toy
from validation.conventions import ENCODER_BODIES
from validation.errors import ValidationInputError
from validation.infer.blocks import INSTRUMENT, make_blocks
from validation.infer.observations import (
    ObservedTrial,
    add_drive_errors,
    observe_driven,
    share_key_errors,
)
from validation.infer.response import DRAWS, SEGMENTS, Case, ModelResponse, driven_tangents
from validation.infer.unknowns import FORCE, KEY, unknowns

ACTION = model.load_action("hirschkorn2004-regulated")
PRELOAD_N, COUNT_RAD, SCALE = 0.3, 2e-5, 1e-2
TIME = np.arange(0.0, 0.16, 2e-4)


@pytest.fixture(scope="module")
def turn() -> np.ndarray:
    """Turns of all bodies in a soft blow, the arm resting on the key."""
    rest = model.rest_state(ACTION, force_n=PRELOAD_N)
    force = PRELOAD_N + np.interp(TIME, [0.04, 0.06, 0.15], [0.0, 6.0, 6.0])
    return np.asarray(model.simulate(ACTION, TIME, force, tolerance=1e-8, initial=rest).angle_rad - rest.angle_rad)


def seen(turn: np.ndarray, scale: float = 0.0) -> ObservedTrial:
    """The blow as an encoder of the key with an error of scale sees it."""
    change = turn[:, ENCODER_BODIES] * [1.0 + scale, 1.0, 1.0]
    m = SimpleNamespace(
        number=1, time_s=TIME, change_rad=change, u_rad=np.full(3, 3e-5), resolution_rad=np.full(3, COUNT_RAD),
        scale_relative_u=np.array([SCALE, 1e-3, 1e-3]), film=None, quiet=Quiet(150, 0.0, 0.03, 0.04),
        force=SimpleNamespace(channel=ForceChannel(preload_n=PRELOAD_N)),
    )  # fmt: skip
    (trial,) = observe_driven("blow", 0, [m], phases=20)  # type: ignore[list-item]
    return trial


def test_the_model_under_its_own_key_gives_its_own_whippen_and_hammer(turn: np.ndarray) -> None:
    trial = seen(turn)
    assert trial.channels == (1, 2) and trial.force_n.size == 0 and trial.change_rad.shape[1] == 2
    ((curve,),) = ModelResponse(ACTION, (), [trial]).curves([np.zeros(0)])
    assert np.max(np.abs(curve - trial.change_rad)) < 3e-4 * np.ptp(trial.change_rad)


def test_the_error_of_its_encoder_is_taken_off_the_motion(turn: np.ndarray) -> None:
    """An encoder that reads one u too much, and is taken to, gives the motion that was."""
    true, wrong = seen(turn), seen(turn, SCALE)
    runs = ModelResponse(ACTION, KEY, [wrong])
    read, mended = (points[0] for points in runs.curves([np.zeros(2), np.array([1.0, 0.0])]))
    ((here,),) = ModelResponse(ACTION, (), [true]).curves([np.zeros(0)])
    assert np.max(np.abs(mended - here)) < 0.05 * np.max(np.abs(read - here))


def test_derivatives_and_what_the_encoder_leaves_open(turn: np.ndarray) -> None:
    free = replace(unknowns(ACTION, ["contact07.friction", "key.joint_friction"], ["*"]), force=KEY)
    runs = ModelResponse(ACTION, free.moved, [seen(turn)])
    zero = np.zeros(4)
    (slope,) = runs.jacobian(zero, range(4))
    ends = [runs.curves([0.02 * s * np.eye(4)[0]])[0] for s in (1.0, -1.0)]
    apart = (ends[0][0] - ends[1][0]) / 0.04  # type: ignore[index]
    assert np.max(np.abs(slope[:, :, 0] - apart)) < 0.05 * np.max(np.abs(apart))
    assert not slope[:, :, 1].any()  # the key's friction acts on the force alone
    (own,) = runs.jacobian(zero, (), driven=True)
    assert own.shape[2] == DRAWS
    spread = np.sqrt((own**2).sum(axis=2)).max(axis=0)  # of whippen and hammer: a fraction of a count, magnified
    assert np.all(spread > 0.01 * COUNT_RAD) and np.all(spread < 30 * COUNT_RAD)


def test_the_zero_of_the_key_is_rounded_in_each_trial(turn: np.ndarray) -> None:
    """It moves whippen and hammer as an error of the encoder's zero does, which all trials share."""
    trial = replace(seen(turn), u_key_rad=COUNT_RAD / np.sqrt(12.0))
    runs = ModelResponse(ACTION, KEY, [trial])
    (found,) = runs.jacobian(np.zeros(2), [1], driven=True)
    zero, own = np.moveaxis(found, 2, 0)[0], found[:, :, 1:]
    share = np.einsum("tc,tci->i", zero, own) / np.sum(zero**2)
    assert 0.7 < np.sqrt(np.sum(share**2)) < 1.4  # 24 draws know it to 15 %


def test_derivatives_are_of_what_a_film_sees_by_its_late_clock(turn: np.ndarray) -> None:
    """Frames 1 ms late are compared with the motion then, and with its derivatives then."""
    trial, late = seen(turn), 1e-3
    film = replace(trial, channels=(1, 2, 3, 4), film_time_s=trial.time_s + 4e-5)
    lines = [driven_tangents((ACTION, ("hammer.mass",), Case({}, film_late_s=s), film)) for s in (late, 0.0)]  # type: ignore[arg-type]
    shifted = replace(film, film_time_s=film.film_time_s + late)  # type: ignore[operator]
    then = driven_tangents((ACTION, ("hammer.mass",), Case({}), shifted))  # type: ignore[arg-type]
    np.testing.assert_allclose(lines[0], then, rtol=1e-3, atol=1e-3 * np.abs(then).max())
    assert np.max(np.abs(lines[1] - then)[:, 2:]) > 5e-3 * np.abs(then[:, 2:]).max()


def test_errors_of_the_key_are_one_thing_where_both_kinds_are_fitted(turn: np.ndarray) -> None:
    by_force, by_key = toy.trial(1, np.zeros((toy.M, 3)) + 0.01), replace(seen(turn), session=1)
    asked = toy.free()
    assert add_drive_errors(asked, [by_force]).force == FORCE
    assert add_drive_errors(asked, [by_key]).force == KEY
    assert add_drive_errors(asked, [by_force, by_key]).force == (*FORCE, *KEY)
    assert not share_key_errors([by_force])[0].key_moves
    shared, _ = share_key_errors([by_force, by_key])
    ones = np.ones((toy.M, 3, 2))
    for trial, moves in ((by_force, False), (shared, True)):
        (block,) = make_blocks([trial], [ones], [ones], np.ones(2, dtype=bool))
        key = block.instrument[: toy.M, [INSTRUMENT.index(f"key encoder {part}") for part in ("scale", "zero")]]
        assert key.any() != moves


def test_trials_of_both_kinds_come_back_in_their_order(turn: np.ndarray) -> None:
    by_key, zero = seen(turn), [np.zeros(1)]
    by_force = replace(toy.trial(1, np.zeros((toy.M, 3))), force_n=np.minimum(40.0 * toy.TIME, 4.0))
    parameters = unknowns(ACTION, ["hammer.mass"], ["*"]).asked
    mixed = ModelResponse(ACTION, parameters, [by_key, by_force, by_key])
    (joined,), jacobian = mixed.curves(zero), mixed.jacobian(zero[0], [0], driven=True)
    assert joined is not None
    for k, trial in enumerate(mixed.trials):
        alone = ModelResponse(ACTION, parameters, [trial])
        ((curve,),), (slope,) = alone.curves(zero), alone.jacobian(zero[0], [0], driven=True)
        np.testing.assert_array_equal(joined[k], curve)
        np.testing.assert_allclose(jacobian[k], slope, rtol=1e-6, atol=1e-9)
    assert [j.shape[1:] for j in jacobian] == [(2, 1 + DRAWS), (3, 2 + SEGMENTS), (2, 1 + DRAWS)]


def test_a_key_that_loses_its_angles_is_refused_by_name(turn: np.ndarray) -> None:
    with pytest.raises(ValidationInputError, match="blow, trial 1: "):
        broken = turn.copy()
        broken[300:, 0] *= 1e9
        seen(broken)
