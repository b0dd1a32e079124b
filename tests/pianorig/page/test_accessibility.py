"""Every view for a screen reader, in light and dark: axe-core finds nothing; by keyboard everything can be reached."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.pianorig.page.conftest import Page
from tests.pianorig.page.stories import opened

VIEWS = {
    "sessions?session=example_forte": "#trials",
    "review?session=example_forte&trial=1": "main[data-ready]",
    "review?session=example_forte&trial=1&session2=example_forte&trial2=3": "main[data-ready]",
    "live?session=example_forte": "main[data-ready]",
    "action": "main[data-ready]",
    "outlines?film=example_forte&trial=1": "main[data-ready]",
}


@contextmanager
def shown(browser: Any, page: Page, view: str, **options: Any) -> Iterator[Any]:
    """A tab of somebody who may write, with a view."""
    with opened(browser, page, **options) as tab:
        tab.goto(f"{page.address}#{view}")
        tab.reload()
        tab.locator(VIEWS[view]).first.wait_for()
        yield tab


def check_by_axe(tab: Any, at_least: int) -> None:
    """axe-core has looked at so many things and finds nothing."""
    axe = pytest.importorskip("axe_playwright_python", reason="axe-playwright-python carries axe-core")
    tab.evaluate(next(Path(axe.__file__).parent.rglob("axe.min.js")).read_text(encoding="utf-8"))
    found = tab.evaluate("axe.run()")
    worst = {one["id"]: [node["html"][:160] for node in one["nodes"]] for one in found["violations"]}
    assert worst == {} and len(found["passes"]) > at_least


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("view", VIEWS)
def test_axe_core_finds_nothing(browser: Any, filmed: Path, writing: Page, view: str, scheme: str) -> None:
    with shown(browser, writing, view, color_scheme=scheme) as tab:
        check_by_axe(tab, 20)


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_every_view_fits_at_200_percent_and_on_a_phone(browser: Any, filmed: Path, writing: Page, view: str) -> None:
    with shown(browser, writing, view) as tab:
        for width in (1280, 640, 400):  # 640: what is left of 1280 at 200 %
            tab.set_viewport_size({"width": width, "height": 900})
            tab.wait_for_timeout(300)
            wide = (
                "[...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1)"
            )
            found = tab.evaluate(f"{wide}.filter(e => !e.closest('.scroll')).map(e => e.tagName + '.' + e.className)")
            assert tab.evaluate("document.documentElement.scrollWidth") <= width, (width, found[:5])


@pytest.mark.slow
def test_an_exported_animation_for_a_screen_reader(browser: Any, looking: Page, tmp_path: Path) -> None:
    kept = tmp_path / "kept.html"
    kept.write_text(looking.ask("/api/action/hirschkorn2004/animation?blow=forte").json["text"], encoding="utf-8")
    for scheme in ("light", "dark"):
        tab = browser.new_page(color_scheme=scheme)
        tab.goto(kept.as_uri())
        tab.locator("main[data-ready]").wait_for()
        tab.evaluate("window.benchPlayer.run(false)")
        check_by_axe(tab, 10)
        tab.close()


@pytest.mark.slow
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
