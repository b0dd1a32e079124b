"""Resumed runs give the numbers of uninterrupted ones; single frames are fitted again; the backward pass confirms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vision.tracking.passes
from tests.vision.known_films import PIVOT, bar_motion, bar_scene, dark, error_of, film_of, same_bits
from vision import FrameFlag, InputError, retrack_frames, track

MDEG = np.radians(1e-3)


class StoppedError(Exception):
    """Stands for Ctrl-C."""


def test_resumed_run_gives_the_same_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vision.tracking.passes, "EVERY_ROWS", 16)
    known = film_of(bar_scene("wood"), bar_motion(70, PIVOT, 0.3))
    whole = track(known.film, known.bodies)
    checkpoint = tmp_path / "unfinished.npz"

    def stop(done: int, total: int) -> None:
        if done == 37:
            raise StoppedError

    with pytest.raises(StoppedError):
        track(known.film, known.bodies, checkpoint=checkpoint, progress=stop)
    assert checkpoint.exists()
    stored = checkpoint.read_bytes()
    resumed = track(known.film, known.bodies, checkpoint=checkpoint)
    assert 16 <= resumed.info["rows_resumed"] <= 37 and not checkpoint.exists()
    same_bits(resumed, whole)
    # nothing is resumed from another job or a damaged file
    checkpoint.write_bytes(stored)
    other = track(known.film, known.bodies, every=2, checkpoint=checkpoint)
    assert other.info["rows_resumed"] == 0
    damages = (b"", b"no archive", stored[:1000], stored[: len(stored) // 2] + b"\0" * 99)
    for damaged in damages:
        checkpoint.write_bytes(damaged)
        again = track(known.film, known.bodies, checkpoint=checkpoint)
        assert again.info["rows_resumed"] == 0
        same_bits(again, whole)
    with pytest.raises(InputError, match="cannot be written"):
        track(known.film, known.bodies, checkpoint=tmp_path / "absent" / "unfinished.npz")


def test_a_frame_alone_gives_what_the_film_gave() -> None:
    pose = bar_motion(70, PIVOT, 0.3)
    known = film_of(bar_scene("speckle"), pose)
    result = track(known.film, known.bodies)
    near = {"bar": (result.angle_rad[50, 0] + 0.03, result.x_px[50, 0] - 2.0, result.y_px[50, 0] + 1.5)}
    alone = retrack_frames(known.film, known.bodies, [50], [near])
    assert alone.frame.tolist() == [50] and alone.time_s[0] == result.time_s[50]
    # no weights from a neighbour: the same to a small part of the uncertainty
    assert abs(alone.angle_rad[0, 0] - result.angle_rad[50, 0]) < 0.2 * result.u_angle_rad[50, 0]
    assert alone.u_angle_rad[0, 0] == pytest.approx(result.u_angle_rad[50, 0], rel=0.05)
    far = {"bar": (result.angle_rad[50, 0] + 2.0, 20.0, 20.0)}
    with pytest.raises(InputError, match="each once"):
        retrack_frames(known.film, known.bodies, [50, 50], [near, near])
    lost = retrack_frames(known.film, known.bodies, [50], [far])
    assert lost.is_lost[0, 0] and np.isnan(lost.angle_rad[0, 0])
    with pytest.raises(InputError, match="frame 70"):
        retrack_frames(known.film, known.bodies, [70], [near])
    with pytest.raises(InputError, match="body bar"):
        retrack_frames(known.film, known.bodies, [50], [{}])
    with pytest.raises(InputError, match="body bar"):
        retrack_frames(known.film, known.bodies, [50], [{"bar": near["bar"][1:]}])
    for none in (0, -3, 2.5):
        with pytest.raises(InputError, match="max_pixels"):
            track(known.film, known.bodies, max_pixels=none)


def test_frames_alone_know_their_motion() -> None:
    """Terms of the budget that need neighbours are the film's, whichever frames are asked for, at its end too."""
    known = film_of(bar_scene("speckle"), bar_motion(70, PIVOT, 0.3))
    options = {"rows_per_s": 2e5, "u_time_s": 1e-4}
    result = track(known.film, known.bodies, **options)
    frames = [69, 20, 50, 51]
    near = [{"bar": (result.angle_rad[k, 0], result.x_px[k, 0], result.y_px[k, 0])} for k in frames]
    alone = retrack_frames(known.film, known.bodies, frames, near, **options)
    assert alone.frame.tolist() == frames
    for name in ("rows", "synchronisation"):
        whole, part = result.budget.absolute[name][frames], alone.budget.absolute[name]
        assert whole[1:].min() > 0.0
        np.testing.assert_allclose(part, whole, rtol=0.05, atol=0.002 * whole.max())
    # only a whole film measures its stretch
    totals = [one.budget.total(without=("aspect", "synchronisation")) for one in (alone, result)]
    np.testing.assert_allclose(totals[0], totals[1][frames], rtol=0.05)


def test_backward_pass_takes_back_a_wrong_stretch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses of three rows are spoilt after the forward pass, by a pixel at the rim; the backward pass does not confirm
    them. Of one that is spoilt by a twentieth of a pixel the difference is in its uncertainty."""
    known = film_of(bar_scene("speckle"), bar_motion(70, PIVOT, 0.3))
    forward = vision.tracking.passes.track_forward

    def spoil(tracker: object, table: object, *rest: object) -> int:
        done = forward(tracker, table, *rest)
        table.pose[40:43, 0, 0] += 1000 * MDEG
        table.pose[50, 0, 0] += 60 * MDEG
        table.store(30, 0, tracker.trackers[0].fit, FrameFlag.NOT_CONVERGED)
        return done

    monkeypatch.setattr("vision.tracking.track_film.track_forward", spoil)
    result = track(known.film, known.bodies, confirm="all")
    assert np.flatnonzero(result.is_lost[:, 0]).tolist() == [40, 41, 42]
    assert 55 * MDEG < result.u_angle_rad[50, 0] < 70 * MDEG > 10 * result.u_angle_rad[49, 0]
    assert np.all(result.flag[40:43, 0] & int(FrameFlag.UNCONFIRMED))
    assert np.all(np.isnan(result.angle_rad[40:43])) and np.all(np.isnan(result.u_total_rad[40:43]))
    assert result.flag[30, 0] == int(FrameFlag.REACQUIRED), "found by the backward pass only"
    assert np.nanmax(np.abs(error_of(result, known.pose))) < 5 * np.nanmax(result.u_angle_rad)
    with pytest.raises(InputError, match="confirm"):
        track(known.film, known.bodies, confirm="maybe")


def test_only_doubtful_rows_are_seen_twice() -> None:
    pose = bar_motion(90, PIVOT, 0.3)
    clean = film_of(bar_scene("speckle"), pose)
    assert track(clean.film, clean.bodies).info["rows_confirmed"] == 0
    known = film_of(bar_scene("speckle"), pose, cover=dark(range(50, 55)))
    result = track(known.film, known.bodies)
    assert result.info["rows_confirmed"] == 12 + 5 + 1 + 4
    assert np.flatnonzero(result.is_lost[:, 0]).tolist() == [50, 51, 52, 53, 54]
