"""The virtual camera: the film shows the angles it says, and tracking finds them within the stated uncertainty."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vision.tracking.passes
import vision.tracking.segments
from rig.simulated import ActionGeometry, CameraSettings, FilmTruth, film_bodies, film_trial
from rig.simulated.bench.camera import film_scene, poses
from rig.simulated.device.faults import parse_faults
from rig.simulated.device.state import FaultPlan
from vision import InputError, TrackResult, open_film
from vision import track as track_film
from vision.film.mraw import MrawFilm

REST = np.array([0.0251, 0.3198, 0.3523])
N = 215


def blow(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """A blow: the whippen rises by 0.09 rad, the jack trips by -0.35, the lever follows by 0.22, up to 25 rad/s."""

    def step(start: float, length: float) -> NDArray[np.float64]:
        x = np.clip((time_s - start) / length, 0.0, 1.0)
        return x**3 * (10 - 15 * x + 6 * x * x)

    return REST + np.column_stack(
        [0.09 * step(0.04, 0.04), -0.35 * step(0.06, 0.026), 0.22 * step(0.05, 0.03) - 0.1 * step(0.09, 0.02)]
    )


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, FilmTruth]]:
    """A short film and its truth."""
    path = tmp_path_factory.mktemp("film") / "trial_0001.mraw"
    settings = CameraSettings(texture="wood")
    time_s = 62.5e-6 + np.arange(N) / settings.frame_rate_hz
    truth = film_trial(path, time_s, blow, settings=settings, seed=4)
    yield path, truth


def test_film_is_tracked_near_the_bound(filmed: tuple[Path, FilmTruth]) -> None:
    path, truth = filmed
    result = track_film(path, film_bodies(), truth.frame_time_s)
    assert not result.failed.any() and 40 <= result.n_still <= 85
    assert result.bodies == truth.bodies == ("whippen", "jack", "repetition")
    for k, body in enumerate(result.bodies):
        if body == "whippen":
            angle, u = result.angle_rad[:, 0], result.u_angle_rad[:, 0]
        else:
            angle, u, _ = result.relative(body)
        error = angle - (truth.mean_angle_rad[:, k] - truth.mean_angle_rad[: result.n_still, k].mean())
        rms = np.sqrt(np.mean(error**2))
        assert rms < 1.3 * truth.relative_crlb_rad[k], f"{body}: {rms / truth.relative_crlb_rad[k]:.2f} of the bound"
        assert 0.90 <= np.mean(np.abs(error) < 1.96 * u) <= 0.995, body
        assert 0.85 < np.std(error / u) < 1.15, body


def in_two_threads(monkeypatch: pytest.MonkeyPatch, path: Path, truth: FilmTruth, **options: Any) -> TrackResult:
    """Four stretches of the film, tracked by two threads unless ``options`` say otherwise."""
    monkeypatch.setattr(vision.tracking.segments, "STRETCH_ROWS", 50)
    return track_film(path, film_bodies(), truth.frame_time_s, **{"threads": 2, **options})


def assert_same_bits(one: TrackResult, other: TrackResult) -> None:
    for name in ("angle_rad", "u_angle_rad", "u_total_rad", "flag"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    for term, values in one.budget.absolute.items():
        np.testing.assert_array_equal(values, other.budget.absolute[term], term)


def test_three_bodies_in_two_threads_give_the_bits_of_one_thread(
    filmed: tuple[Path, FilmTruth], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, truth = filmed
    one = in_two_threads(monkeypatch, path, truth, threads=1)
    assert one.bodies == ("whippen", "jack", "repetition")
    assert_same_bits(in_two_threads(monkeypatch, path, truth), one)


def test_ctrl_c_ends_the_threads_and_the_next_run_goes_on(
    filmed: tuple[Path, FilmTruth], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A signal comes after 100 rows, while two threads track: none goes on, and nothing but the checkpoint is left."""
    path, truth = filmed
    monkeypatch.setattr(vision.tracking.passes, "EVERY_ROWS", 20)
    kept, threads, signals = tmp_path / "kept.npz", threading.active_count(), list[int]()

    def stop(done: int, _: int) -> None:
        if done >= 100 and not signals:
            signals.append(done)
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        in_two_threads(monkeypatch, path, truth, checkpoint=kept, progress=stop)
    assert threading.active_count() == threads
    assert list(tmp_path.iterdir()) == [kept]
    again = in_two_threads(monkeypatch, path, truth, checkpoint=kept)
    assert again.info["rows_resumed"] >= 20 and not kept.exists()
    assert_same_bits(again, in_two_threads(monkeypatch, path, truth))


def test_film_file(filmed: tuple[Path, FilmTruth]) -> None:
    path, truth = filmed
    assert sorted(p.suffix for p in path.parent.iterdir()) == [".cihx", ".mraw"]
    assert path.stat().st_size == N * 304 * 400  # a byte for each pixel of 8 bits
    with open_film(path) as film:
        assert isinstance(film, MrawFilm)
        assert (film.n_frames, film.height, film.width, film.bit_depth) == (N, 304, 400, 8)
        assert film.frame_rate_hz == 2000.0 and film.exposure_s == pytest.approx(125e-6)
        assert film.frame_time_s is not None
        # the header counts from the camera's first frame, the truth in the time of the trial
        np.testing.assert_allclose(np.diff(film.frame_time_s), np.diff(truth.frame_time_s), rtol=1e-9)
        # 120 Hz ripple of the light: whole-picture grey against the cosine that was asked for
        grey = np.array([film.read(i).mean(dtype=float) for i in range(60)])
        wave = np.cos(2 * np.pi * 120.0 * truth.frame_time_s[:60])
        ripple = np.polyfit(wave, grey / grey.mean(), 1)
        assert ripple[0] == pytest.approx(0.05, rel=0.05)


def test_truth_is_what_was_asked_for(filmed: tuple[Path, FilmTruth]) -> None:
    _, truth = filmed
    np.testing.assert_array_equal(truth.angle_rad, blow(truth.frame_time_s))
    # mean over the exposure, by fine quadrature
    offset = 125e-6 * ((np.arange(400) + 0.5) / 400 - 0.5)
    for i in (0, 110, 135, 150, 190):
        fine = blow(truth.frame_time_s[i] + offset).mean(axis=0)
        np.testing.assert_allclose(truth.mean_angle_rad[i], fine, atol=2e-6)
    assert truth.n_instants > N  # moving frames are blurred
    assert np.all(truth.crlb_rad > 0) and np.degrees(truth.crlb_rad.max()) < 0.010


def test_pivots_land_where_the_geometry_says() -> None:
    """Pivots by hand: ground frame in metres, y up, to pixels, y down."""
    geometry, settings = ActionGeometry(), CameraSettings()
    angles = np.array([[0.1, -0.05, 0.4]])
    place = poses(geometry, settings, angles)[0]
    jack = place[2]  # drawn last, in front
    x = -0.1810 + 0.0989 * np.cos(0.1) + 0.0035 * np.sin(0.1)
    y = 0.0528 + 0.0989 * np.sin(0.1) - 0.0035 * np.cos(0.1)
    assert jack[0] == pytest.approx(0.05)
    assert jack[1] == pytest.approx((x - settings.left_m) * 3200)
    assert jack[2] == pytest.approx((settings.top_m - y) * 3200)


def test_depth_and_repeatability(tmp_path: Path) -> None:
    bits, size = 12, 304 * 400 * 3 * 3 // 2
    settings = CameraSettings(bit_depth=bits)
    time_s = np.arange(3) / 2000.0
    told: list[tuple[int, int]] = []
    for name, seed in (("a", 8), ("b", 8), ("c", 9)):
        film_trial(tmp_path / f"{name}.mraw", time_s, blow, None, settings, seed, lambda *at: told.append(at))
    assert told == [(1, 3), (2, 3), (3, 3)] * 3
    data = {name: (tmp_path / f"{name}.mraw").read_bytes() for name in "abc"}
    assert len(data["a"]) == size and data["a"] == data["b"] != data["c"]
    with open_film(tmp_path / "a.mraw") as film:
        assert film.bit_depth == bits
        assert 0.2 * 2**bits < film.read(0).mean() < 0.6 * 2**bits


def test_a_picture_that_is_kept_shows_what_drawing_each_frame_in_full_shows(tmp_path: Path) -> None:
    """Bodies that creep by 1.2e-4 px a frame are drawn seldom: no pixel is off by more than rounding and 0.1 grey."""
    settings = CameraSettings(noise_grey=0.0, flicker=0.0)
    n, creep = 40, np.array([2e-7, 3e-7, -4e-7])  # rad a frame

    def angles(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(REST + (time_s * 2000.0)[:, None] * creep)

    film_trial(tmp_path / "creep.mraw", np.arange(n) / 2000.0, angles, settings=settings, seed=5)
    scene, shown = film_scene(settings, 5), set()
    with open_film(tmp_path / "creep.mraw") as film:
        for i in range(n):
            frame = film.read(i)
            full = scene.light(poses(ActionGeometry(), settings, angles(np.array([i / 2000.0]))))
            assert np.abs(frame - full).max() < 0.5 + 0.1
            shown.add(frame.tobytes())
    assert 2 <= len(shown) <= n // 4


def test_refusals_leave_nothing(tmp_path: Path) -> None:
    time_s = np.arange(4) / 2000.0
    path = tmp_path / "film.mraw"
    with pytest.raises(InputError, match="increasing"):
        film_trial(path, time_s[::-1], blow)
    with pytest.raises(InputError, match=r"\(4, 3\)"):
        film_trial(path, time_s, lambda t: blow(t)[:, :2])
    with pytest.raises(InputError, match="cannot be written"):
        film_trial(tmp_path / "absent" / "film.mraw", time_s, blow)
    assert list(tmp_path.iterdir()) == []
    for bad in ({"texture": "silk"}, {"bit_depth": 10}, {"exposure_s": 1.0}, {"width": 3}, {"flicker": 2.0}):
        with pytest.raises(InputError, match=next(iter(bad)).split("_")[0]):
            CameraSettings(**bad)


def test_five_frames_are_dropped_from_the_moment_on_wherever_blocks_end() -> None:
    """A frame a millisecond; the count stands still at 10 until five are missing, then goes on without them."""
    count, time_s = np.arange(21), np.arange(21) / 1000.0
    for end in (7, 11, 14):  # 11: the moment is the last sample of its block
        plan = FaultPlan(parse_faults("dropped@1/0.01"))
        parts = [plan.drop_exposures(1, time_s[part], count[part]) for part in (slice(end), slice(end, None))]
        assert np.concatenate(parts).tolist() == [*range(10), *[10] * 6, *range(11, 16)]
