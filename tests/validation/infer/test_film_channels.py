"""What of a film is compared: each phase's own frame, lost ones left out, its errors told apart."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.validation.infer import toy
from validation.infer.blocks import INSTRUMENT, LOST_RAD, make_blocks, residuals
from validation.infer.observations import ENCODERS, FILM, add_film_angles, read_film
from validation.measurement.trial import FilmAngles

FRAME_S = np.arange(0.0, 0.2, 4e-3)


def filmed(lost: int = 20, u_total: float = 1e-3) -> SimpleNamespace:
    """A trial whose film shows the jack turn at a steady rate, and one frame lost."""
    jack = 0.5 * FRAME_S
    jack[lost] = np.nan
    noise = np.full(FRAME_S.size, 3e-4)
    change = {"jack": jack, "repetition": 0.1 * FRAME_S}
    total = {name: np.hypot(noise, u_total * np.abs(np.nan_to_num(curve))) for name, curve in change.items()}
    film = FilmAngles(FRAME_S, change, total, 2e-5, None, dict.fromkeys(change, noise))
    return SimpleNamespace(film=film, quiet=SimpleNamespace(end_s=0.0161))


def test_each_frame_counts_once_at_its_own_time() -> None:
    phases = np.arange(0.02, 0.1, 1e-3)  # four phases a frame
    seen = read_film(filmed(), phases)  # type: ignore[arg-type]
    there = np.isfinite(seen.change_rad[:, 1])
    assert np.unique(seen.time_s[there]).size == there.sum() == 21
    np.testing.assert_allclose(seen.change_rad[there, 1], 0.1 * seen.time_s[there])
    lost = np.isnan(seen.change_rad[:, 0])
    assert lost.sum() == (~there).sum() + 1  # the lost frame is lost for the jack alone
    np.testing.assert_array_equal(seen.time_s[~there], phases[~there])


def test_reference_and_scale_are_told_from_noise() -> None:
    seen = read_film(filmed(), np.arange(0.02, 0.1, 1e-3))  # type: ignore[arg-type]
    np.testing.assert_allclose(seen.u_scale, 1e-3, rtol=1e-6)
    np.testing.assert_allclose(seen.u_zero_rad, 3e-4 / np.sqrt(5))  # of five frames before the blow
    assert seen.u_time_s == 2e-5


def test_frames_before_and_after_the_film_are_lost() -> None:
    seen = read_film(filmed(), np.array([-0.05, 0.05, 0.5]))  # type: ignore[arg-type]
    np.testing.assert_array_equal(np.isfinite(seen.change_rad[:, 1]), [False, True, False])


@pytest.mark.parametrize("with_one", [True, False])
def test_what_is_lost_says_nothing(with_one: bool) -> None:
    """Its rows have no residual, no derivative and an uncertainty beyond anything."""
    plain = toy.trial(1, np.zeros((toy.M, 3)))
    m = filmed() if with_one else SimpleNamespace(film=None)
    trial = add_film_angles(plain, m)  # type: ignore[arg-type]
    assert trial.channels == (*ENCODERS, *FILM) and np.array_equal(trial.column("hammer"), plain.change_rad[:, 2])
    ones = np.ones((toy.M, 5, 3))
    (block,) = make_blocks([trial], [ones], [ones[:, :, :2]], np.ones(3, dtype=bool))
    (apart,) = residuals([trial], [np.full((toy.M, 5), 0.3)])
    lost = np.isnan(trial.change_rad).T.ravel()
    assert lost.any() and (with_one or lost[3 * toy.M :].all())
    assert not apart[lost].any() and not block.moved[lost].any() and not block.own[lost].any()
    assert np.all(block.white[lost] == LOST_RAD**2) and np.all(block.white[~lost] < 1e-6)
    shown = ~lost & (np.arange(lost.size) >= 3 * toy.M)
    scale = block.instrument[:, [INSTRUMENT.index(f"{name} film scale") for name in ("jack", "repetition")]]
    np.testing.assert_allclose(
        scale.sum(axis=1)[shown], 1e-3 * trial.change_rad.T.ravel()[shown], rtol=1e-6, atol=1e-12
    )
