"""What the page of `pianorig bench` costs and how quickly it follows: scope, film, slider.

A journal of eight channels at 5 kHz is written in real time, a block of 20 ms at once, as a recorder writes it; its
force is the time at which each sample was taken, so that a drawn picture tells how old its newest sample is. In
headless Chromium: sample to pixel, pictures a second, processor time of the server, heap of the page; then scrubbing a
film of 1,780 frames of 400 x 304, and from a slider's event to the redrawn curves. Needs the extras `bench` and `dev`
and a Chromium. Figures depend on what else the machine does; the load is printed beside them.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from playwright.sync_api import sync_playwright

from benchmarks.runner import Run
from rig.backend import Block
from rig.session import Session
from rig.session.info import ChannelInfo
from rig.session.journal import JournalWriter, TrialHead
from tests.pianorig.page.conftest import CHROMIUM, EXAMPLE, own_process
from vision.film.mraw import write_mraw

FURTHER, BLOCK, RATE_HZ = 4, 100, 5000.0  # force, three encoders and four more; samples
FRAMES, HEIGHT, WIDTH = 1780, 304, 400
MINUTE_S = 60.0
WATCH = """() => { window.seen = []; const scope = () => document.querySelector('.scope'); let before = '';
  const look = () => { const s = scope(); if (s && s.dataset.drawn !== before) { before = s.dataset.drawn;
    window.seen.push([Number(s.dataset.drawn), Number(s.dataset.last)]); } requestAnimationFrame(look); }; look(); }"""
SCRUB = """async () => { const P = window.benchPlayer, F = window.benchFilm, n = F.film.n_frames, before = F.drawn;
  const began = performance.now(); let k = 0;
  await new Promise((done) => { const step = () => { k += 2; if (k >= n) { done(); return; }
    P.go(F.film.time_s[k]); requestAnimationFrame(step); }; step(); });
  return [F.drawn - before, (performance.now() - began) / 1000]; }"""
SLIDE = """async () => { const m = document.querySelector('main');
  const s = document.getElementById('set-contact08.second.y');
  const out = []; for (let i = 0; i < 60; i++) { s.value = Number(s.value) + Number(s.step); // never the same again
    delete m.dataset.latency; const began = performance.now(); s.dispatchEvent(new Event('input'));
    while (!m.dataset.latency) await new Promise((next) => requestAnimationFrame(next));
    await new Promise((next) => requestAnimationFrame(() => setTimeout(next))); out.push(performance.now() - began); }
  return out; }"""


class Writer(threading.Thread):
    """A recording in real time; `lost` samples would be those the journal did not take."""

    def __init__(self, session: Session, seconds: float) -> None:
        super().__init__(name="recording")
        data = session.trials[0].read()
        known = {one.name: getattr(data, one.name) for one in fields(TrialHead) if hasattr(data, one.name)}
        info = ChannelInfo("further", "voltage", "V", "-", "-", (0.0, 1.0), (0.0, 1.0))
        channels = tuple(replace(info, name=f"further_{k}") for k in range(FURTHER))
        number = len(session.trials) + 1
        head = TrialHead(**{**known, "number": number, "command_v": np.zeros(10), "channels": channels})
        self.blocks = int(seconds * RATE_HZ / BLOCK)
        self.journal = JournalWriter(session.journal_path(number), head, self.blocks * BLOCK, self.blocks)
        self.began_s, self.longest_s = 0.0, 0.0

    def run(self) -> None:
        """Write a block whenever its last sample has been taken."""
        self.began_s = time.time()
        taken = np.arange(BLOCK) / RATE_HZ
        more = np.sin(np.linspace(0, 6.28, BLOCK))[:, None] * np.ones(FURTHER)
        counts = np.zeros((BLOCK, 3), dtype=np.int64)
        for k in range(self.blocks):
            due = self.began_s + (k + 1) * BLOCK / RATE_HZ
            time.sleep(max(0.0, due - time.time()))
            force = k * BLOCK / RATE_HZ + taken
            before = time.perf_counter()
            self.journal.append(Block(k * BLOCK, force, force, counts, channel_values=more))
            self.longest_s = max(self.longest_s, time.perf_counter() - before)
        self.journal.close("interrupted", "end of the benchmark")
        self.lost = self.blocks * BLOCK - self.journal.committed_samples


def processor_s(process: psutil.Process) -> float:
    """Processor time of a process so far, s."""
    used = process.cpu_times()
    return float(used.user + used.system)


def scope(tab: Any, address: str, session: Session, server: psutil.Process, seconds: float, reload_s: float) -> int:
    """The rolling scope, perhaps reloaded now and then; samples the recording lost."""
    writer = Writer(session, seconds)
    writer.start()
    tab.goto(f"{address}#live")
    tab.locator("main[data-ready]").wait_for()
    tab.evaluate(WATCH)
    devtools = tab.context.new_cdp_session(tab)
    spent, began, ages, heaps = processor_s(server), time.time(), [], []
    next_reload, next_look = began + reload_s, began + MINUTE_S

    def look() -> None:
        for drawn, last in tab.evaluate("(() => { const s = window.seen; window.seen = []; return s; })()"):
            if np.isfinite(last):
                ages.append(drawn / 1e3 - writer.began_s - last)

    while writer.is_alive():
        tab.wait_for_timeout(1000)
        look()
        if time.time() >= next_look:
            devtools.send("HeapProfiler.collectGarbage")
            heaps.append(tab.evaluate("performance.memory.usedJSHeapSize") / 1e6)
            print(f"  minute {(time.time() - began) / MINUTE_S:4.1f}: heap {heaps[-1]:.2f} MB", flush=True)
            next_look += MINUTE_S
        if time.time() >= next_reload and writer.is_alive():
            tab.reload()
            tab.locator("main[data-ready]").wait_for()
            tab.evaluate(WATCH)
            next_reload += reload_s
    share = (processor_s(server) - spent) / (time.time() - began)
    look()
    age = np.array(ages)[10:]
    print(f"scope, {seconds:g} s of 8 x 5 kHz: {len(age) / seconds:.1f} pictures/s")
    print(f"  server: {100 * share:.1f} % of a core")
    print(
        f"  newest sample to pixel: median {1e3 * np.median(age):.0f} ms, p99 {1e3 * np.quantile(age, 0.99):.0f} ms "
        f"(the first of its block is {1e3 * BLOCK / RATE_HZ:.0f} ms older)"
    )
    if len(heaps) >= 4:
        late = np.arange(len(heaps))[1:]  # the first minute fills the ring of 30 s
        slope = np.polyfit(late, np.array(heaps)[1:], 1)[0]
        print(f"  heap after collection: {min(heaps):.2f} to {max(heaps):.2f} MB, trend {60 * slope:+.2f} MB an hour")
    print(f"  recording: {writer.lost} samples lost, longest write of a block {1e3 * writer.longest_s:.1f} ms")
    return writer.lost


def film(tab: Any, address: str) -> None:
    """Scrubbing."""
    tab.goto(f"{address}#review?session=mine&trial=1")
    tab.reload()
    tab.locator("main[data-ready]").wait_for()
    frames, seconds = tab.evaluate(SCRUB)
    print(f"film of {FRAMES} frames of {WIDTH} x {HEIGHT}: {frames / seconds:.0f} frames/s drawn while scrubbing")


def slider(tab: Any, address: str) -> None:
    """From a slider to the curves."""
    tab.goto(f"{address}#action")
    tab.reload()
    tab.locator("main[data-ready]").wait_for()
    found = tab.evaluate(SLIDE)[5:]
    print(f"slider to curves: median {np.median(found):.0f} ms, p90 {np.quantile(found, 0.9):.0f} ms")


def main(run: Run) -> bool:
    """Measure the views asked for; whether the recording lost nothing."""
    lost = 0
    with tempfile.TemporaryDirectory() as work:
        shutil.copytree(EXAMPLE, Path(work) / "mine", ignore=shutil.ignore_patterns("derived"))
        session = Session.open(Path(work) / "mine")
        random = np.random.default_rng(1).integers(0, 200, (16, HEIGHT, WIDTH), dtype=np.uint8)
        write_mraw(session.path / "trial_0001.mraw", (random[k % 16] for k in range(FRAMES)), 2000.0, exposure_s=1e-4)
        with own_process(Path(work)) as (process, page), sync_playwright() as driver:
            address, server = page.address, psutil.Process(process.pid)
            browser = driver.chromium.launch(
                executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--enable-precise-memory-info"]
            )
            tab = browser.new_page(viewport={"width": 1280, "height": 1000})
            tab.set_default_timeout(120_000)
            print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", flush=True)
            if "scope" in run.only:
                lost = scope(tab, address, session, server, run.seconds, run.reload)
            if "film" in run.only:
                film(tab, address)
            if "slider" in run.only:
                slider(tab, address)
            browser.close()
    return lost == 0
