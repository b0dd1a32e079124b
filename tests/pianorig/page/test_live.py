"""The scope: every sample once and in order, the state of the trial, and a recording that knows nothing of it."""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianorig.workflows import judge_trials
from rig import Session
from rig.session.info import NO_FORCE
from tests.command_line import run
from tests.pianorig.page.conftest import Page, heard, own_process
from tests.pianorig.page.recordings import recording
from tests.pianorig.page.stories import opened, until

stream_module = pytest.importorskip("pianorig.page.live")


def rows(samples: bytes, columns: int) -> tuple[int, np.ndarray]:
    return int(struct.unpack("<d", samples[:8])[0]), np.frombuffer(samples[8:], "<f4").reshape(-1, columns)


def test_samples_are_sent_once_in_the_order_of_the_channels(folder: Path) -> None:
    root = folder / "example_forte"
    stream = stream_module.LiveStream(root)
    state, samples = stream.poll()
    assert state is not None and not state["recording"] and samples == b"" and len(state["figures"]) == 3
    assert stream.poll() == (None, b"")
    with recording(root) as made:
        made.append(700)
        state, samples = stream.poll()
        assert state is not None and state["recording"] and (state["trial"], state["rate_hz"]) == (4, 5000.0)
        names = [channel["name"] for channel in state["channels"]]
        assert names == ["force", "key", "whippen", "hammer", "motor_command"]
        assert rows(samples, 5)[0] == 0 and len(rows(samples, 5)[1]) == 700
        assert stream.poll() == (None, b"")
        found = [rows(samples, 5)[1]]
        for count in (1, 2000, 99):
            made.append(count)
            state, samples = stream.poll()
            first, new = rows(samples, 5)
            assert state is None and (first, len(new)) == (sum(map(len, found)), count)
            found.append(new)
        shown, data = np.concatenate(found), made.data
    n = len(shown)
    np.testing.assert_allclose(shown[:, 0], data.raw_force_n[:n], atol=1e-5)
    np.testing.assert_allclose(shown[:, 1:4], np.degrees(data.angle_rad[:n]) * [-1, 1, -1], atol=1e-5)
    np.testing.assert_allclose(shown[:, 4], data.motor_command_v[:n], atol=1e-6)


def test_a_sealed_trial_brings_its_figures_and_the_next_starts_anew(folder: Path) -> None:
    root = folder / "example_forte"
    stream = stream_module.LiveStream(root)
    stream.poll()
    with recording(root) as made:
        made.append(500)
        stream.poll()
        data = made.data
    (root / "trial_0004.journal").unlink()
    Session.open(root).add_trial(replace(data, number=4, status="fault", reason="force <above> limit", sha256=""))
    state, samples = stream.poll()
    assert state is not None and not state["recording"] and samples == b""
    last = state["figures"][-1]
    assert (last["trial"], last["status"], last["reason"]) == (4, "fault", "force <above> limit")
    assert last["raw_peak_force_n"] == pytest.approx(data.raw_force_n.max())
    Session.open(root).annotate(4, "reject", "fault")
    state, _ = stream.poll()
    assert state is not None and state["figures"][-1]["rejected"]
    with recording(root, 5) as made:
        made.append(10)
        state, samples = stream.poll()
        assert state is not None and state["trial"] == 5 and rows(samples, 5)[0] == 0


def test_over_the_wire(folder: Path, looking: Page) -> None:
    with recording(folder / "example_forte") as made:
        made.append(300)
        (state, samples), _ = heard(looking, "/live/example_forte", 2)
    assert json.loads(state)["recording"] and len(rows(samples, 5)[1]) == 300
    (message,), reason = heard(looking, "/live/..")
    assert message is None and "no session" in str(reason)


def test_a_recording_rolls_by_pauses_and_is_found_again(browser: Any, folder: Path, looking: Page) -> None:
    root = folder / "example_forte"
    drawn = "Number(document.querySelector('.scope').dataset.samples)"
    with recording(root) as made, opened(browser, looking, f"{looking.address}#live") as tab:
        tab.locator("main[data-ready]").wait_for()
        tab.get_by_text("● recording").wait_for()
        for _ in range(5):
            made.append(400)
        until(tab, f"{drawn} === 2000")
        assert "trial 4" in tab.locator(".values").first.inner_text()
        tab.keyboard.press("p")
        made.append(400)
        tab.wait_for_timeout(200)
        assert tab.evaluate(drawn) == 2000
        tab.keyboard.press("p")
        until(tab, f"{drawn} === 2400")
        assert tab.evaluate("Number(document.querySelector('.scope').dataset.last)") == pytest.approx(
            float(made.data.raw_force_n[2399]), abs=1e-4
        )
        tab.reload()
        until(tab, f"document.querySelector('.scope') && {drawn} === 2400")
        made.append(100)
        until(tab, f"{drawn} === 2500")
        assert made.writer.committed_samples == 2500


def test_the_last_judged_trial_stands_beside_the_model(browser: Any, folder: Path, looking: Page) -> None:
    ended = threading.Event()
    ended.set()
    judge_trials.judge_trials(folder / "example_forte", "hirschkorn2004", ended, lambda text: None)
    with opened(browser, looking, f"{looking.address}#live") as tab:
        tab.get_by_text("trial 3: RMSE key").wait_for()
        canvas = tab.get_by_role("img", name="Measured and predicted angles of the last trial")
        inked = "c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some((v, i) => i % 4 === 3 && v)"
        assert canvas.evaluate(inked)


def test_a_scale_that_was_typed_stays_from_trial_to_trial(browser: Any, folder: Path, looking: Page) -> None:
    root = folder / "example_forte"
    with opened(browser, looking, f"{looking.address}#live") as tab:
        for number in (4, 5):
            with recording(root, number) as made:
                made.append(400)
                tab.get_by_text(f"trial {number} ", exact=False).first.wait_for()
                if number == 4:
                    tab.get_by_text("Scale of each channel").click()
                    tab.get_by_label("Force, lower end, N").fill("-7")
                    tab.get_by_label("Force, upper end, N").fill("70")
        assert tab.get_by_label("Force, upper end, N").input_value() == "70"


def wait_for(folder: Path, pattern: str) -> None:
    """Wait until a recorder has made such a file."""
    for _ in range(1200):
        if any(folder.glob(pattern)):
            return
        time.sleep(0.05)
    raise AssertionError(f"no {pattern} was recorded")


RECORD = ("record", "--profile", "piano", "--trials", "40", "--backend", "sim://?seed=5", "--out")
"""By the virtual clock, which makes the same trials each time; by a real one the bench is stepped in other pieces.
Trials take a tenth of a second each: so many that the page of a busy machine comes before the last."""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_no_sample_is_lost_with_the_page_open_stalled_and_killed(browser: Any, folder: Path) -> None:
    """The virtual bench plays the same trials from a seed, so every sample can be compared."""
    watched, alone = folder / "watched", folder / "alone"
    with own_process(folder) as (server, page):
        tab = browser.new_page()
        tab.goto(f"{page.address}#live?session=example_forte")
        tab.locator("main[data-ready]").wait_for()
        with subprocess.Popen([sys.executable, "-m", "pianorig", *RECORD, str(watched)]) as recorder:
            try:
                wait_for(watched, "*.journal")
                tab.evaluate("location.hash = 'live?session=watched'")
                until(tab, "Number(document.querySelector('.scope')?.dataset.samples) > 100")
                server.send_signal(signal.SIGSTOP)
                wait_for(watched, "trial_0003.*")
                server.send_signal(signal.SIGKILL)
                assert recorder.poll() is None, "it was over before the page was"
                assert recorder.wait(120) == 0
            finally:
                recorder.kill()
    tab.close()
    assert run(*RECORD, alone) == 0
    for one, other in zip(Session.open(alone).trials, Session.open(watched).trials, strict=True):
        ours, theirs = one.read(), other.read()
        assert ours.status == theirs.status == "complete"
        for name in ("raw_force_n", "force_raw", "encoder_count", "motor_command_v"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_a_session_without_force_is_sent_as_plain_json(folder: Path, looking: Page) -> None:
    example = Session.open(folder / "example_forte")
    data, made = example.trial(1).read(), Session.create(folder / "no_force", example.info)
    nothing = np.full_like(data.raw_force_n, np.nan)
    made.add_trial(replace(data, raw_force_n=nothing, force_raw=nothing, force_info=NO_FORCE))
    (state,), _ = heard(looking, "/live/no_force")
    (figures,) = json.loads(state, parse_constant=pytest.fail)["figures"]
    assert (
        figures["raw_peak_force_n"] is None and figures["raw_rest_force_n"] is None and figures["turned_deg"]["key"] > 1
    )


def test_after_a_trial_the_scope_keeps_its_curves_and_its_seconds(browser: Any, folder: Path, looking: Page) -> None:
    root = folder / "example_forte"
    shade = """(() => { const c = document.querySelector('.scope');
      const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n; })()"""
    with opened(browser, looking, f"{looking.address}#live?session=example_forte") as tab:
        with recording(root) as made:
            tab.get_by_text("● recording").wait_for()
            made.append(2500)
            until(tab, "Number(document.querySelector('.scope')?.dataset.samples) === 2500")
            assert "trial 4 of 3" not in tab.locator(".values").first.inner_text()
            during = tab.evaluate(shade)
        made.session.journal_path(4).unlink()  # as when a trial is sealed
        tab.get_by_text("nothing is being recorded").wait_for()
        tab.wait_for_timeout(100)
        assert tab.locator(".values").first.inner_text().startswith("last: trial 4, 0.5 s")
        assert during > 0 and tab.evaluate(shade) == pytest.approx(during, rel=0.02)
