"""A user goes from view to view with one session, zooms curves and film, reads values by pointing, saves pictures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.pianorig.page.conftest import Page
from tests.pianorig.page.stories import opened, until

NOW = "window.benchPlayer.time"


@pytest.fixture
def tab(browser: Any, shown: Page) -> Any:
    with opened(browser, shown, f"{shown.address}#review?session=example_forte&trial=1", accept_downloads=True) as tab:
        tab.locator("main[data-ready]").wait_for()
        yield tab


def ticks(tab: Any) -> list[float]:
    """Times at the left and right end of the plots, s."""
    return tab.evaluate("(() => { const r = window.benchCurves.range; return [r.start, r.end]; })()")


def test_the_chosen_session_goes_from_view_to_view(tab: Any) -> None:
    links = {a.inner_text(): a.get_attribute("href") for a in tab.locator("nav a").all()}
    assert links["Sessions"] == "#sessions?session=example_forte" and links["Live"] == "#live?session=example_forte"
    assert links["Review"] == "#review?session=example_forte&trial=1"
    assert links["Outlines"] == "#outlines?film=example_forte&trial=1"
    tab.locator("nav").get_by_text("Action").click()
    tab.locator("main[data-ready] #events").wait_for()
    tab.locator("nav").get_by_text("Outlines").click()
    tab.locator("main[data-ready] .film").wait_for()
    assert "example_forte, trial 1" in tab.locator("main select").first.locator("option:checked").inner_text()
    tab.locator("nav").get_by_text("Sessions").click()
    tab.get_by_role("heading", name="example_forte").wait_for()


def test_wheel_box_and_buttons_zoom_all_plots(tab: Any) -> None:
    whole = ticks(tab)
    plot = tab.locator(".plot").nth(1).bounding_box()
    x, y = plot["x"] + 0.6 * plot["width"], plot["y"] + 0.5 * plot["height"]
    tab.mouse.move(x, y)
    before = tab.locator(".head .values").nth(1).inner_text()
    tab.mouse.wheel(0, -100)
    near = ticks(tab)
    assert near[0] > whole[0] and near[1] < whole[1]
    assert tab.locator(".head .values").nth(1).inner_text() == before  # what is pointed at keeps its place
    tab.mouse.wheel(0, 100)
    assert ticks(tab) == pytest.approx(whole)
    tab.keyboard.down("Shift")
    tab.mouse.down()
    tab.mouse.move(x + 60, y + 20)
    tab.mouse.up()
    tab.keyboard.up("Shift")
    boxed = ticks(tab)
    assert boxed[1] - boxed[0] == pytest.approx((whole[1] - whole[0]) * 60 / (plot["width"] - 68), rel=0.02)
    tab.get_by_role("button", name="Whole", exact=True).click()
    assert ticks(tab) == pytest.approx(whole)
    tab.get_by_role("button", name="Zoom in", exact=True).click()
    assert ticks(tab)[1] - ticks(tab)[0] == pytest.approx((whole[1] - whole[0]) / 1.25**2)


def test_pointing_tells_values_and_leaving_tells_those_of_the_cursor(tab: Any) -> None:
    values = tab.locator(".head .values").nth(1)
    tab.evaluate("window.benchPlayer.go(0.1)")
    at_rest = values.inner_text()
    assert "measured" in at_rest and "hirschkorn2004" in at_rest
    assert tab.locator(".legend .line").nth(1).evaluate("e => getComputedStyle(e).borderTopStyle") == "solid"
    assert tab.locator(".legend .line").nth(2).evaluate("e => getComputedStyle(e).borderTopStyle") == "dashed"
    plot = tab.locator(".plot").nth(1).bounding_box()
    tab.mouse.move(plot["x"] + 0.5 * plot["width"], plot["y"] + 0.5 * plot["height"])
    assert values.inner_text() != at_rest and tab.evaluate(NOW) == 0.1
    tab.mouse.move(5, 5)
    until(tab, f"document.querySelectorAll('.head .values')[1].innerText === {at_rest!r}")


def test_pictures_are_saved_with_their_legend(tab: Any, tmp_path: Path) -> None:
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save picture").click()
    assert download.value.suggested_filename == "example_forte-trial-1.png"
    download.value.save_as(tmp_path / "curves.png")
    picture = cv2.imread(str(tmp_path / "curves.png"))
    assert picture.shape[0] > 400 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    tab.evaluate("window.benchPlayer.go(window.benchFilm.film.time_s[40])")
    until(tab, "Number(document.querySelector('.film canvas').dataset.frame) === 40")
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save frame").click()
    assert download.value.suggested_filename == "trial_0001-frame-40.png"


def test_the_film_is_zoomed_and_its_grey_values_read(tab: Any) -> None:
    tab.evaluate("window.benchPlayer.go(window.benchFilm.film.time_s[0])")
    until(tab, "Number(document.querySelector('.film canvas').dataset.frame) === 0")
    canvas = tab.locator(".film canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = round(box["x"] + 0.27 * box["width"]), round(box["y"] + 0.73 * box["height"])  # a wheel knows whole pixels
    tab.mouse.move(x, y)
    said = tab.locator(".film .head .hint")
    there = said.inner_text()
    film = tab.evaluate("[window.benchFilm.film.width, window.benchFilm.film.height]")
    shown = [float(word) for word in re.findall(r"\d+\.\d", there)]
    assert shown == pytest.approx([0.27 * film[0] - 0.5, 0.73 * film[1] - 0.5], abs=0.4) and " px: grey " in there
    for _ in range(4):
        tab.mouse.wheel(0, -100)
    assert float(canvas.get_attribute("data-zoom")) == pytest.approx(1.25**4, abs=1e-3)
    tab.mouse.move(x + 1, y)
    tab.mouse.move(x, y)
    assert said.inner_text() == there  # what is pointed at keeps its place
    tab.keyboard.down("Shift")
    tab.mouse.down()
    tab.mouse.move(x + 0.1 * box["width"], y + 0.1 * box["height"])
    tab.mouse.up()
    tab.keyboard.up("Shift")
    assert canvas.get_attribute("data-zoom") == "16.000"  # the largest there is
    tab.get_by_role("button", name="Whole frame").click()
    assert canvas.get_attribute("data-zoom") == "1.000"
