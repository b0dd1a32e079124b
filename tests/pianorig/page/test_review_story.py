"""A user follows a blow from frame to frame: cursor, curves, film, outlines and drawing go together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.pianorig.page.conftest import FRAMES, Page
from tests.pianorig.page.stories import opened, until

FRAME = "Number(document.querySelector('.film canvas').dataset.frame)"
NOW = "window.benchPlayer.time"


@pytest.fixture
def tab(browser: Any, shown: Page) -> Any:
    with opened(browser, shown, f"{shown.address}#review?session=example_forte&trial=1") as tab:
        tab.locator("main[data-ready]").wait_for()
        yield tab


def settled(tab: Any, frame: int) -> None:
    until(tab, f"{FRAME} === {frame}")


def test_frames_events_and_curves_by_keys(tab: Any) -> None:
    tab.locator("body").press("Home")
    tab.evaluate("window.benchPlayer.go(window.benchFilm.film.time_s[40])")
    settled(tab, 40)
    for key, frame in (("ArrowRight", 41), ("ArrowLeft", 40), ("Shift+ArrowRight", 50), ("Shift+ArrowLeft", 40)):
        tab.keyboard.press(key)
        settled(tab, frame)
    assert "frame 40 of 120" in tab.locator(".film .values").inner_text()
    first = tab.evaluate(NOW)
    tab.keyboard.press("n")
    until(tab, f"{NOW} > {first}")
    at_event = tab.evaluate(NOW)
    moments = tab.evaluate("window.benchPlayer.events.map(e => e.time_s)")
    assert any(abs(at_event - moment) < 1e-9 for moment in moments)
    tab.keyboard.press("p")
    until(tab, f"{NOW} !== {at_event}")
    tab.evaluate(f"window.benchPlayer.go({at_event})")
    until(tab, f"document.querySelector('.drawing canvas').dataset.time == {at_event}")
    # the cursor stands over the curves where the time is
    place = """(() => { const c = document.querySelector('.cursor').getBoundingClientRect(),
      h = document.querySelector('.curves').getBoundingClientRect(); return (c.left - h.left) / h.width; })()"""
    tab.keyboard.press("Home")
    until(tab, f"{place} < 0.2")
    tab.keyboard.press("End")
    until(tab, f"{place} > 0.9")
    # a lost body is named and red
    tab.evaluate("window.benchPlayer.go(window.benchFilm.film.time_s[60])")
    settled(tab, 60)
    assert "whippen lost" in tab.locator(".film .values").inner_text()
    red = """() => { const c = document.querySelector('.film canvas');
      const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] > 240 && d[i + 1] < 80 && d[i + 2] < 80; return n; }"""
    assert tab.evaluate(red) > 50
    tab.get_by_role("checkbox", name="outlines").uncheck()
    assert tab.evaluate(red) == 0


def test_a_point_in_a_plot_is_a_time_and_playing_stops_at_the_end(tab: Any) -> None:
    plot = tab.locator(".plot").nth(1).bounding_box()
    tab.mouse.click(plot["x"] + 0.5 * plot["width"], plot["y"] + 0.5 * plot["height"])
    until(tab, f"Math.abs({NOW} - 0.63) < 0.05")
    until(tab, "Math.abs(Number(new URLSearchParams(location.hash.split('?')[1]).get('t')) - 0.63) < 0.05")
    tab.reload()  # the time is in the address
    tab.locator("main[data-ready]").wait_for()
    until(tab, f"Math.abs({NOW} - 0.63) < 0.05")
    # from there it plays through the film and stops at the end
    tab.get_by_label("Speed").select_option("0.25")
    tab.evaluate("window.benchPlayer.go(window.benchFilm.film.time_s[0])")
    settled(tab, 0)
    tab.locator("h1").click()
    tab.keyboard.press("Space")
    until(tab, f"{FRAME} > 20")
    tab.keyboard.press("Space")
    assert tab.get_by_role("button", name="Play").count() == 1
    tab.evaluate("window.benchPlayer.go(window.benchPlayer.to - 1e-3); window.benchPlayer.run(true)")
    until(tab, f"{NOW} === window.benchPlayer.to && !window.benchPlayer.running")
    settled(tab, FRAMES - 1)


def test_two_models_side_by_side_and_measured_beside_model(tab: Any) -> None:
    tab.get_by_label("beside model").select_option("hirschkorn2004-regulated")
    tab.locator(".values", has_text="hirschkorn2004-regulated").first.wait_for()
    until(tab, "document.querySelector('main').dataset.ready === 'true'")
    assert tab.locator(".pair .drawing").count() == 2
    height = tab.evaluate("document.querySelector('.drawing canvas').height")
    scale = tab.locator(".forces caption")
    assert scale.nth(0).text_content() == scale.nth(1).text_content()  # forces of both on one scale
    tab.get_by_label("measured above, model below").first.check()
    assert tab.evaluate("document.querySelector('.drawing canvas').height") == 2 * height
    assert tab.evaluate("document.documentElement.scrollWidth") <= 1280


def test_two_trials_side_by_side_and_an_animation_to_keep(tab: Any, browser: Any, tmp_path: Path) -> None:
    tab.get_by_label("beside trial of").select_option("example_forte")
    tab.get_by_role("heading", name="example_forte, trial 2").wait_for()
    tab.locator("#review-trial2").select_option("3")
    tab.get_by_role("heading", name="example_forte, trial 3").wait_for()
    until(tab, "document.querySelector('main').dataset.ready === 'true'")
    assert tab.locator(".pair .drawing canvas").count() == 2
    titles = tab.locator(".pair h2").all_inner_texts()
    assert titles == ["example_forte, trial 1", "example_forte, trial 3"]
    tab.keyboard.press("n")
    now = tab.evaluate(NOW)
    times = "[...document.querySelectorAll('.pair .drawing canvas')].map(c => Number(c.dataset.time))"
    until(tab, f"Math.abs({times}[0] - {now}) < 1e-9")
    first, second = tab.evaluate(times)
    assert second - first == pytest.approx(2e-4, abs=1e-5)  # moved, so that a common event falls together
    tab.get_by_label("How many times slower").fill("33")
    tab.keyboard.press("Tab")
    assert tab.evaluate("window.benchPlayer.rate()") == pytest.approx(1 / 33)
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save animation").click()
    download.value.save_as(tmp_path / "kept.html")
    other = browser.new_page()
    asked: list[str] = []
    other.on("request", lambda request: asked.append(request.url))
    other.goto((tmp_path / "kept.html").as_uri())
    other.locator("main[data-ready]").wait_for()
    assert other.evaluate("window.benchPlayer.running") and len(asked) == 1
    assert "Measured and" in other.locator(".drawing").first.inner_text()
    began = other.evaluate("JSON.parse(document.getElementById('data').textContent).start_s")
    assert 0.3 < began < now
    until(other, f"window.benchPlayer.time > {began}")
    other.close()
