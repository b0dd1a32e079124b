"""Every view for a screen reader, in light and dark: axe-core finds nothing; by keyboard everything can be reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.pianorig.page.conftest import Page
from tests.pianorig.page.stories import opened, until

VIEWS = {
    "sessions?session=example_forte": "#trials",
    "review?session=example_forte&trial=1&session2=example_forte&trial2=3": "main[data-ready]",
    "live?session=example_forte": "main[data-ready]",
    "action": "main[data-ready]",
    "outlines?film=example_forte&trial=1": "main[data-ready]",
}


def check_by_axe(tab: Any, at_least: int) -> None:
    """axe-core has looked at so many things in light and finds nothing, and in dark no colours too close."""
    axe = pytest.importorskip("axe_playwright_python", reason="axe-playwright-python carries axe-core")
    tab.evaluate(next(Path(axe.__file__).parent.rglob("axe.min.js")).read_text(encoding="utf-8"))
    for scheme, options, passes in (("light", "{}", at_least), ("dark", "{runOnly: ['color-contrast']}", 0)):
        tab.emulate_media(color_scheme=scheme)
        found = tab.evaluate(f"axe.run({options})")
        worst = {one["id"]: [node["html"][:160] for node in one["nodes"]] for one in found["violations"]}
        assert worst == {} and len(found["passes"]) > passes, scheme


@pytest.mark.parametrize("view", VIEWS)
def test_axe_core_finds_nothing_and_every_view_fits(browser: Any, shown: Page, view: str) -> None:
    with opened(browser, shown, f"{shown.address}#{view}") as tab:
        tab.locator(VIEWS[view]).first.wait_for()
        check_by_axe(tab, 20)
        for width in (640, 400):  # what is left of 1280 px at 200 %, and a phone
            tab.set_viewport_size({"width": width, "height": 900})
            until(tab, f"innerWidth === {width} && document.documentElement.scrollWidth <= {width}", turns=100)


def test_an_exported_animation_for_a_screen_reader(browser: Any, shown: Page, tmp_path: Path) -> None:
    kept = tmp_path / "kept.html"
    kept.write_text(shown.ask("/api/action/hirschkorn2004/animation?blow=forte").json["text"], encoding="utf-8")
    tab = browser.new_page()
    tab.goto(kept.as_uri())
    tab.locator("main[data-ready]").wait_for()
    tab.evaluate("window.benchPlayer.run(false)")
    check_by_axe(tab, 10)
    tab.close()


def test_the_way_by_keyboard(browser: Any, looking: Page) -> None:
    with opened(browser, looking) as tab:
        tab.locator("#sessions tbody tr").first.wait_for()
        tab.keyboard.press("Tab")
        assert tab.evaluate("document.activeElement.className") == "skip"
        for wanted in ("Sessions", "Live", "Review", "Outlines", "Action"):
            tab.keyboard.press("Tab")
            assert tab.evaluate("document.activeElement.textContent") == wanted
        seen = []
        for _ in range(16):
            tab.keyboard.press("Tab")
            seen.append(tab.evaluate("document.activeElement.textContent || document.activeElement.id"))
        assert "search" in seen and "example_forte" in seen and "Verdict" in seen
        outline = "getComputedStyle(document.activeElement).outlineStyle"
        assert tab.evaluate(outline) == "solid"  # where one is can be seen
