"""Video files of a turning bar whose angles are known: every frame at its time, or a line that says why not."""

from __future__ import annotations

import re
import threading
import warnings
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from tests.command_line import run
from tests.vision.turning_bar import BODY, OUTLINES, smooth_turn, turning_bar, write_video
from vision import FilmError, VisionWarning, track
from vision.film import video_reader
from vision.film.open import open_film
from vision.film.time_scale import frame_times_at_rate
from vision.film.video_index import open_container

ALL = np.arange(60)
GAP = np.r_[0:30, 40:70]
LOSSLESS = {"codec": "libx264", "pixels": "yuv444p", "options": {"qp": "0", "bf": "2"}}


def film_at(places: np.ndarray) -> np.ndarray:
    """Frames of the bar at frame numbers of a camera of constant rate, 70 of them."""
    return _film_at(tuple(places.tolist()))


@cache
def _film_at(places: tuple[int, ...]) -> np.ndarray:
    return turning_bar(smooth_turn(np.array(places), places[-1] + 1))


def read(path: Path) -> tuple[Any, list[str]]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        film = open_film(path)
    return film, [str(one.message) for one in said]


CASES: dict[str, tuple[str, np.ndarray, dict[str, Any], float]] = {
    "MKV, 5000/s": ("f.mkv", ALL, {"rate": 5000}, 5000.0),
    "MKV, 10000/s": ("f.mkv", ALL, {"rate": 10_000, **LOSSLESS}, 10_000.0),
    "MOV with a gap, play-back scale": ("f.mov", GAP, {"stamps": GAP, "rate": 25, **LOSSLESS}, 2000.0),
    "MP4, half of the frames left out at random": (
        "f.mp4",
        (some := np.flatnonzero(np.random.default_rng(4).random(120) < 0.5)),
        {"stamps": some, "rate": 30, **LOSSLESS},
        1000.0,
    ),
    "AVI with a gap": ("f.avi", GAP, {"codec": "ffv1", "stamps": GAP, "rate": 500}, 500.0),
}


@pytest.mark.parametrize("name", CASES)
def test_angles_are_at_their_times(name: str, tmp_path: Path) -> None:
    file, places, options, rate = CASES[name]
    n = int(places[-1]) + 1
    frames = film_at(places)
    film, said = read(write_video(tmp_path / file, frames, **options))
    with film, warnings.catch_warnings(record=True) as more:
        warnings.simplefilter("always")
        assert film.n_frames == places.size
        for k in (0, 41, 7, places.size - 1):
            off = np.abs(film.read(k).astype(int) - frames[k])
            assert off.max() <= (22 if film.white_grey else 1), "frames in their order"
        times = frame_times_at_rate(film, rate)
        result = track(film, [BODY], times) if np.any(np.diff(places) > 1) else None
    np.testing.assert_allclose(times - times[0], (places - places[0]) / rate, atol=2e-7)
    lines = said + [str(one.message) for one in more]
    if result is not None:
        missing = int(np.sum(np.diff(places) - 1))
        assert any(f"{missing} frames missing" in line for line in lines), lines
        error = result.angle_rad[:, 0] - smooth_turn((times - times[0]) * rate + places[0], n)
        good = result.flag[:, 0] == 0
        assert good.mean() > 0.9 and np.abs(error[good] / result.u_angle_rad[good, 0]).max() < 5.0


def test_a_coarse_container_says_what_its_stamps_do_not_show(tmp_path: Path) -> None:
    film, said = read(write_video(tmp_path / "f.mkv", film_at(ALL)[:30], rate=10_000))
    film.close()
    assert any("rounded to 1 ms, and a frame lasts 0.1 ms: frames left out would not show" in line for line in said)


def test_an_edit_list_is_obeyed(tmp_path: Path) -> None:
    """Eight frames lie before time zero of the film, as `ffmpeg -ss … -c copy` leaves them."""
    frames = film_at(ALL)
    options = {"codec": "libx264", "pixels": "yuvj444p", "options": {"qp": "0", "bf": "0"}}
    path = write_video(
        tmp_path / "f.mp4", frames, stamps=ALL - 8, container={"avoid_negative_ts": "disabled"}, **options
    )
    film, said = read(path)
    assert any("shows 52 of 60 stored frames (an edit list" in line for line in said)
    with film:
        assert film.n_frames == 52
        np.testing.assert_allclose(film.frame_time_s, np.arange(52) / 2000.0, atol=1e-9)
        for k in (0, 51, 20):
            assert np.abs(film.read(k).astype(int) - frames[k + 8]).max() <= 2


@pytest.mark.filterwarnings("default::vision.errors.VisionWarning")
def test_a_ramp_of_play_back_is_refused_and_one_without_a_rate_is_said(tmp_path: Path, capsys: Any) -> None:
    paces = np.rint(20.0 * (1.0 + 3.0 * np.sin(np.linspace(0.0, np.pi, 59)) ** 2)).astype(int)
    stamps = np.r_[0, np.cumsum(paces)]
    path = write_video(tmp_path / "f.mov", film_at(ALL), stamps=stamps, rate=600, **LOSSLESS)
    (tmp_path / "b.toml").write_text(OUTLINES)
    common = ["track", str(path), "--bodies", str(tmp_path / "b.toml"), "--out", str(tmp_path / "o.csv")]
    assert run(*common, "--frame-rate", "2000") == 2
    assert re.search(r"change pace, from 7\.\d+ to 2\d\.\d+ frames/s", capsys.readouterr().err)
    assert not (tmp_path / "o.csv").exists()
    assert run(*common) == 0
    assert "at a pace that changes" in capsys.readouterr().err


def test_interlaced_pixel_aspect_and_white_are_told(tmp_path: Path) -> None:
    frames = film_at(ALL)[:20]
    interlaced = {"codec": "mpeg2video", "pixels": "yuv420p", "rate": 25, "options": {"flags": "+ilme+ildct"}}
    film, _ = read(write_video(tmp_path / "i.avi", frames, **interlaced))
    with film:
        assert film.is_interlaced and film.white_grey == 235
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as file:
        stream: Any = file.add_stream("libx264", rate=1000)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt = "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(9, 8)
        for grey in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")))
        file.mux(stream.encode())
    film, _ = read(path)
    with film:
        assert film.pixel_aspect == 9 / 8 and not film.is_interlaced


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_turned_film_is_turned_as_its_file_wants(tmp_path: Path, degrees: int) -> None:
    frames = film_at(ALL)[:6]
    path = tmp_path / "r.mp4"
    with av.open(str(path), "w") as file:
        stream: Any = file.add_stream("libx264", rate=25, options={"qp": "0"})
        stream.height, stream.width, stream.pix_fmt = *frames[0].shape, "yuvj444p"
        if not hasattr(stream, "set_display_rotation"):
            pytest.skip("this PyAV writes no rotation")
        stream.set_display_rotation(degrees)
        for grey in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuvj444p")))
        file.mux(stream.encode())
    film, said = read(path)
    with film:
        assert any("its file wants the picture turned" in line for line in said)
        shown = film.read(2)
        assert shown.shape == (film.height, film.width)
        turned = np.rot90(frames[2], degrees // 90).astype(int)
        assert np.abs(shown - turned).max() <= 2


def test_frames_that_stand_alone_are_read_by_several_threads(tmp_path: Path) -> None:
    frames = film_at(ALL)
    film, _ = read(write_video(tmp_path / "f.avi", frames, "huffyuv", pixels="rgb24", rate=500))
    found: dict[int, int] = {}

    def look(start: int) -> None:
        for k in range(start, 60, 3):
            found[k] = int(np.abs(film.read(k).astype(int) - frames[k]).max())

    with film:
        assert not film.in_order
        threads = [threading.Thread(target=look, args=(start,)) for start in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert sorted(found) == list(range(60)) and max(found.values()) <= 1


@pytest.mark.parametrize(("name", "options"), [("f.mkv", {}), ("f.mp4", LOSSLESS), ("f.avi", {"rate": 500})])
def test_a_video_cut_short_is_refused_or_read_on_request(tmp_path: Path, name: str, options: dict[str, Any]) -> None:
    movflags = {"movflags": "faststart"} if name == "f.mp4" else {}
    path = write_video(tmp_path / name, film_at(ALL), container=movflags, **options)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.6 * len(whole))])
    with pytest.raises(FilmError, match=r"^[^\n]*(cut short|damaged)[^\n]*$"):
        open_film(path)
    with warnings.catch_warnings(action="ignore", category=VisionWarning):
        film = open_film(path, allow_truncated=True)
    with film:
        assert 10 < film.n_frames < 60
        film.read(film.n_frames - 1)


def add_video(file: Any, codec: str, frames: np.ndarray, pixels: str, rate: int) -> Any:
    stream: Any = file.add_stream(codec, rate=rate)
    stream.height, stream.width, stream.pix_fmt = *frames[0].shape, pixels
    return stream


@pytest.mark.parametrize("ending", ["mkv", "mov", "mp4"])
def test_a_small_video_before_the_film_is_not_taken_for_it(tmp_path: Path, ending: str) -> None:
    frames, path = film_at(ALL)[:9], tmp_path / f"f.{ending}"
    small = np.full((4, 32, 48), 90, np.uint8)
    with av.open(str(path), "w") as file:
        streams = [add_video(file, "libx264", some, "yuv444p", 25) for some in (small, frames)]
        for stream, some in zip(streams, (small, frames), strict=True):
            stream.options = {"qp": "0"}
            for grey in some:
                file.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv444p")))
            file.mux(stream.encode())
    film, said = read(path)
    with film:
        assert (film.n_frames, film.height, film.width) == frames.shape
        assert any("2 videos (48 x 32, 172 x 120), of which number 2, the largest" in line for line in said)


@pytest.mark.parametrize(("pixels", "bits"), [("gbrp10le", 10), ("gbrp12le", 12), ("rgb48le", 16), ("gbrp16le", 16)])
def test_colours_of_more_than_8_bits_keep_them(tmp_path: Path, pixels: str, bits: int) -> None:
    """A ramp of all values of 10 bit: in 8 bits a quarter of its steps would be left."""
    ramp = (np.arange(1024).reshape(16, 64) << (bits - 10)).astype(np.uint16)
    path = tmp_path / "f.mkv"
    with av.open(str(path), "w") as file:
        stream = add_video(file, "ffv1", ramp[None], pixels, 500)
        for _ in range(3):
            colours = np.repeat(ramp[..., None] << (16 - bits), 3, axis=-1)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(colours, format="rgb48le").reformat(format=pixels)))
        file.mux(stream.encode())
    for channel in (None, "green"):
        with open_film(path, channel=channel) as film:
            assert np.all(np.diff(film.read(1).ravel().astype(int)) > 0)
            np.testing.assert_allclose(film.read(1) / 2.0**film.bit_depth, ramp / 2.0**bits, atol=1e-3)


def test_the_times_around_a_gap_are_not_rounded(tmp_path: Path) -> None:
    """240 frames/s in stamps of 1 ms."""
    path = write_video(tmp_path / "f.mkv", film_at(GAP), stamps=GAP, rate=240)
    film, said = read(path)
    with film:
        np.testing.assert_allclose(film.frame_time_s, GAP / 240.0, rtol=4e-3, atol=0)
        assert np.ptp(np.diff(film.frame_time_s)[:20]) < 1e-9
        assert not any("rounded" in line for line in said)


def test_frames_read_backward_are_those_read_forward_and_decoded_few_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A film that is decoded in sequence and of which ten frames are kept: each start anew serves ten steps back."""
    frames = film_at(ALL)
    path, starts = write_video(tmp_path / "f.mkv", frames, rate=1000, **LOSSLESS), list[Path]()
    monkeypatch.setattr(video_reader, "KEPT_BYTES", 10 * 3 * frames[0].size)
    monkeypatch.setattr(video_reader, "open_container", lambda at: (starts.append(at), open_container(at))[1])
    film, _ = read(path)
    with film:
        assert film.in_order
        forward = [np.array(one) for one in film]
        assert len({one.tobytes() for one in forward[20:40]}) == 20
        for i in (*ALL[::-1], *ALL, 30, 25, 31, 29):
            np.testing.assert_array_equal(film.read(int(i)), forward[i])
    assert 6 <= len(starts) <= 10


def test_a_damaged_avi_is_called_damaged(tmp_path: Path) -> None:
    """Predicted frames in an AVI have no stamps of their own: what is missing must not be taken for bad stamps."""
    path = write_video(tmp_path / "f.avi", film_at(ALL), "libx264", pixels="yuv444p", rate=100, options={"bf": "3"})
    data = path.read_bytes()
    path.write_bytes(data[: int(0.7 * len(data))])
    with pytest.raises(FilmError, match="cut short"):
        open_film(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        film = open_film(path, allow_truncated=True)
    with film:
        np.testing.assert_allclose(film.frame_time_s, np.arange(film.n_frames) / 100.0, atol=1e-9)


@pytest.mark.parametrize("ending", ["webm", "ts", "mts", "mpg", "3gp", "mxf"])
def test_containers_of_camcorders_and_the_web_are_read(tmp_path: Path, ending: str) -> None:
    codec, options = {
        "webm": ("libvpx-vp9", {"lossless": "1"}),
        "mpg": ("mpeg2video", {"b": "40M"}),
        "mxf": ("mpeg2video", {"b": "40M"}),
    }.get(ending, ("libx264", {"crf": "1", "bf": "2"}))
    frames = film_at(ALL)[25:45]
    film, _ = read(write_video(tmp_path / f"f.{ending}", frames, codec, pixels="yuv420p", rate=25, options=options))
    with film:
        assert film.n_frames == 20
        np.testing.assert_allclose(film.frame_time_s, np.arange(20) / 25.0, atol=1e-4)
        for k in (0, 19, 11):
            shown = [np.corrcoef(film.read(k).ravel(), other.ravel())[0, 1] for other in frames]
            assert int(np.argmax(shown)) == k


@pytest.mark.parametrize("order", ["tff", "bff"])
@pytest.mark.parametrize(("ending", "codec"), [("mkv", "libx264"), ("mp4", "libx264"), ("mpg", "mpeg2video")])
def test_the_first_field_is_that_of_the_decoded_frames(tmp_path: Path, order: str, ending: str, codec: str) -> None:
    """Matroska stores another code for the same order."""
    graph = av.filter.Graph()
    frames, path = film_at(ALL)[:8], tmp_path / f"f.{ending}"
    height, width = frames[0].shape
    marked = graph.add("setfield", order)
    graph.add_buffer(width=width, height=height, format="yuv420p", time_base=Fraction(1, 25)).link_to(marked)
    marked.link_to(graph.add("buffersink"))
    graph.configure()
    with av.open(str(path), "w") as file:
        stream = add_video(file, codec, frames, "yuv420p", 25)
        stream.options = {"flags": "+ilme+ildct", "x264-params": f"{order}=1"}
        for k, grey in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = k, Fraction(1, 25)
            graph.push(frame)
            file.mux(stream.encode(graph.pull()))
        file.mux(stream.encode())
    film, _ = read(path)
    with film:
        assert film.is_interlaced and film.first_field == {"tff": "even", "bff": "odd"}[order]
