"""Films from another computer: only the trial's own film is taken, whole, with its hash and its first frame."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from pianorig.commands.attach import HEADERS, attach_film
from pianorig.errors import InputError
from pianorig.workflows import SessionFilm, recording, session_folder
from rig import Session, Trial, load_profile, load_rig
from rig import record as record_session
from rig.session.film_record import read_record
from tests.command_line import run
from tests.vision.film.cine_file import write_cine
from tests.vision.turning_bar import write_video
from vision import VisionWarning, open_film, write_mraw
from vision.film.open import READERS

STEP = Path(__file__).parents[2] / "rig" / "step.toml"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("attach") / "s"
    record_session(folder, profile=load_profile(STEP), trials=2)
    return folder


@pytest.fixture
def session(recorded, tmp_path) -> Session:
    import shutil

    return Session.open(shutil.copytree(recorded, tmp_path / "s"))


def film(folder: Path, name: str = "C001", *, n: int = 40, first: int = 100, rate: float = 2000.0) -> Path:
    frames = (np.random.default_rng(3).integers(0, 255, (8, 12), dtype=np.uint8) for _ in range(n))
    path = folder / f"{name}.mraw"
    write_mraw(path, frames, rate, exposure_s=1e-4, start_frame=first)
    return path


def beside(session: Session) -> list[str]:
    return sorted(p.name for p in session.path.iterdir() if p.name.startswith("trial_0002."))


def test_the_film_of_a_trial_is_copied_with_its_header_and_recorded(session, tmp_path, capsys) -> None:
    path = film(tmp_path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert run("attach", path, session.path, "--trial", "2", "--sha256", digest.upper()) == 0
    said, after = capsys.readouterr().out, session.trial(2).read().camera.n_frames - 140
    assert "trial 2: trial_0002.mraw, frames 100 to 139" in said
    assert f"ran on for {after} frames; if the film was not cut there, frames were dropped" in said
    assert beside(session) == ["trial_0002.cihx", "trial_0002.film.toml", "trial_0002.h5", "trial_0002.mraw"]
    trial = session.trial(2)
    assert trial.film.read_bytes() == path.read_bytes() and path.exists()
    record = read_record(trial.film)
    assert (record.sha256, record.n_frames, record.first_frame, record.frame_rate_hz) == (digest, 40, 100, 2000.0)
    assert record.frames_after == after > 0
    (note,) = session.annotations
    assert (note.trial, note.kind) == (2, "note") and digest in note.reason
    with open_film(trial.film) as source:
        times, u_time = SessionFilm(trial.film).frame_times(source)
    np.testing.assert_array_equal(times, trial.read().camera.frame_time_s[100:140])
    with pytest.raises(InputError, match="has a film already"):
        attach_film(path, session.path, 2)
    with pytest.raises(InputError, match="is the film of trial 2 already"):
        attach_film(path, session.path, 1)


def test_a_film_named_in_capitals_keeps_its_header(session, tmp_path) -> None:
    path = film(tmp_path)
    for suffix in (".mraw", ".cihx"):
        path.with_suffix(suffix).rename(path.with_suffix(suffix.upper()))
    attach_film(path.with_suffix(".MRAW"), session.path, 2)
    assert beside(session) == ["trial_0002.cihx", "trial_0002.film.toml", "trial_0002.h5", "trial_0002.mraw"]
    with open_film(session.trial(2).film) as source:
        assert source.n_frames == 40


def test_angles_of_a_film_altered_since_it_was_attached_are_not_kept(session, tmp_path) -> None:
    import pandas as pd

    attach_film(film(tmp_path), session.path, 2)
    trial = session.trial(2)
    outlines = session.path / "bodies.toml"
    outlines.write_text("# any")
    table = pd.DataFrame({"time_s": [0.0, 1.0]})
    SessionFilm(trial.film, outlines).store_angles(table, {})
    assert session.read_derived("angles", 2) is not None
    with trial.film.open("r+b") as stream:
        stream.seek(7)
        stream.write(b"\x01\x02")
    with pytest.raises(InputError, match=r"trial_0002\.mraw: SHA-256 .* altered since"):
        SessionFilm(trial.film, outlines).store_angles(table, {})


@pytest.mark.parametrize(
    ("made", "options", "said"),
    [
        ({"rate": 2003.0}, {}, "2003 frames/s, trial 2 has 2000; allowed within 0.1%"),
        ({"first": -5}, {}, "begins 5 frames before the trigger"),
        ({"first": 5000}, {}, "frames 5000 to 5039, trial 2 has 0 to"),
        ({"n": 9000, "first": 0}, {}, "frames 0 to 8999, trial 2 has 0 to"),
        ({}, {"sha256": "0" * 64}, "SHA-256 .* expected 0000"),
        ({}, {"first_frame": 99}, "its header says first frame 100"),
        ({}, {"frame_rate_hz": 2000.0}, "leave out --frame-rate"),
    ],
)
def test_a_film_that_is_not_the_trial_s_leaves_nothing(made, options, said, session, tmp_path) -> None:
    path = film(tmp_path, **made)
    with pytest.raises(InputError, match=said) as refusal:
        attach_film(path, session.path, 2, **options)
    assert "\n" not in str(refusal.value) and beside(session) == ["trial_0002.h5"] and session.annotations == ()


def test_a_film_without_a_header_needs_its_first_frame_and_real_rate(session, tmp_path) -> None:
    import cv2

    pages = [np.full((8, 12), i, dtype=np.uint8) for i in range(10)]
    path = tmp_path / "film.tif"
    assert cv2.imwritemulti(str(path), pages)
    with pytest.raises(InputError, match="add --first-frame"):
        attach_film(path, session.path, 2)
    with pytest.raises(InputError, match="30 frames/s"):
        attach_film(path, session.path, 2, first_frame=7, frame_rate_hz=30.0)
    attach_film(path, session.path, 2, first_frame=7, frame_rate_hz=2000.0)
    trial = session.trial(2)
    with open_film(trial.film) as source:
        times, _ = SessionFilm(trial.film).frame_times(source)
    np.testing.assert_array_equal(times, trial.read().camera.frame_time_s[7:17])


def test_frames_that_a_camera_left_out_keep_the_others_at_their_times(session, tmp_path, capsys) -> None:
    """A Phantom film whose own times lack six frames; every third frame of a Photron film; a video on 25 frames/s."""
    frames = np.random.default_rng(4).integers(0, 4000, (10, 8, 12), dtype=np.uint16)
    kept = np.r_[0:4, 10:16]
    write_cine(tmp_path / "film.cine", frames, first=7, rate=2000, kept=kept)
    with pytest.warns(VisionWarning, match="6 frames that the clock counted are missing in it, in 1 gaps, .* frame 3"):
        record = attach_film(tmp_path / "film.cine", session.path, 2)
    assert (record.first_frame, record.last_frame, record.frames_missing) == (7, 22, 6)
    trial = session.trial(2)
    clock = trial.read().camera
    assert record.frames_after == clock.n_frames - 23
    with open_film(trial.film) as source:
        times, _ = SessionFilm(trial.film).frame_times(source)
    np.testing.assert_array_equal(times, clock.frame_time_s[7 + kept])
    path = write_video(tmp_path / "film.avi", (frames >> 4).astype(np.uint8), stamps=kept, rate=25)
    with pytest.warns(VisionWarning, match="6 frames that the clock"):
        record = attach_film(path, session.path, 1, first_frame=3, frame_rate_hz=2000.0)
    with open_film(session.trial(1).film) as source:
        times, _ = SessionFilm(session.trial(1).film).frame_times(source)
    np.testing.assert_array_equal(times, clock.frame_time_s[3 + kept])


@pytest.mark.parametrize("suffix", sorted(READERS.keys() - {*HEADERS, ".png", ".bmp", ".jpg", ".jpeg"}))
def test_a_film_of_every_readable_format_is_found_beside_its_trial(suffix, tmp_path) -> None:
    (tmp_path / f"trial_0003{suffix}").touch()
    assert Trial(tmp_path / "trial_0003.h5", 3, None).film == tmp_path / f"trial_0003{suffix}"


def test_a_copy_that_fails_leaves_nothing(session, tmp_path, monkeypatch) -> None:
    path = film(tmp_path)

    def full(source, target) -> None:
        Path(target).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(ValueError, match="No space left"):
        attach_film(path, session.path, 2)
    assert beside(session) == ["trial_0002.h5"] and not list(session.path.glob(".*"))


def test_the_session_is_the_one_named_the_working_folder_or_the_newest(session, tmp_path, monkeypatch) -> None:
    assert session_folder(session.path) == session.path
    with pytest.raises(InputError, match="no session named"):
        session_folder(None, tmp_path / "none")
    assert session_folder(None, tmp_path) == session.path
    monkeypatch.chdir(session.path)
    assert session_folder(None) == Path()


def test_the_film_of_a_virtual_camera_that_runs_by_itself_shows_when_it_exposed(tmp_path, monkeypatch) -> None:
    filmed, benches = [], []
    monkeypatch.setattr(recording, "film_trial", lambda path, times, *rest, **more: filmed.append(times))
    opened = recording.open_backend
    monkeypatch.setattr(recording, "open_backend", lambda *given: benches.append(opened(*given)) or benches[-1])
    text = load_rig("virtual").text.replace('mode = "pulses"', 'mode = "counted"').replace("Mod4/PFI4", "Mod4/PFI0")
    (tmp_path / "rig.toml").write_text(text, "utf-8")
    access = recording.BenchAccess(tmp_path / "rig.toml")
    session, _ = recording.record(tmp_path / "s", access, profile=load_profile(STEP), trials=1, film=[1])
    camera, exposures = session.trial(1).read().camera, benches[0].device.bench.exposures
    number = (filmed[0] - camera.exposure_s / 2 - exposures.first_s) * exposures.rate_hz
    np.testing.assert_allclose(number, np.rint(number[0]) + np.arange(number.size), atol=1e-6)
    assert np.abs(filmed[0] - camera.frame_time_s[np.rint(number).astype(int)]).max() > 1e-6  # what is believed


def test_a_film_on_its_own_is_timed_by_the_middle_of_each_exposure(tmp_path: Path) -> None:
    write_mraw(tmp_path / "film.mraw", np.zeros((3, 4, 6), np.uint8), 1000.0, exposure_s=4e-4)
    alone = SessionFilm(tmp_path / "film.mraw", frame_rate_hz=1000.0)
    with alone.open() as source:
        times, u_time = alone.frame_times(source)
        assert times == pytest.approx([0.0002, 0.0012, 0.0022], abs=1e-9) and u_time == 0.0
        with pytest.raises(ValueError, match=r"a rate of 500 frames/s is stated, the camera's own times say 1000"):
            SessionFilm(tmp_path / "film.mraw", frame_rate_hz=500.0).frame_times(source)


def test_a_trial_to_be_filmed_is_one_of_the_plan(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--film 4: allowed trial numbers 1 to 3"):
        recording.record(tmp_path / "session", film=(4,), trials=3)
