"""Every view for a screen reader, in light and dark: axe-core finds nothing; by keyboard everything can be reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.pianorig.page.conftest import Page
from tests.pianorig.page.stories import opened

VIEWS = {
    "sessions?session=example_forte": "#trials",
    "review?session=example_forte&trial=1": "main[data-ready]",
    "live?session=example_forte": "main[data-ready]",
    "action": "main[data-ready]",
    "outlines?film=example_forte&trial=1": "main[data-ready]",
}


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("view", VIEWS)
def test_axe_core_finds_nothing(browser: Any, filmed: Path, writing: Page, view: str, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python", reason="axe-playwright-python carries axe-core")
    script = next(Path(axe.__file__).parent.rglob("axe.min.js")).read_text(encoding="utf-8")
    name, _, value = str(writing.cookie).partition("=")
    with opened(browser, writing, color_scheme=scheme) as tab:
        tab.context.add_cookies([{"name": name, "value": value, "url": writing.address}])
        tab.goto(f"{writing.address}#{view}")
        tab.reload()
        tab.locator(VIEWS[view]).first.wait_for()
        tab.evaluate(script)
        found = tab.evaluate("axe.run()")
    worst = {one["id"]: [node["html"][:160] for node in one["nodes"]] for one in found["violations"]}
    assert worst == {} and len(found["passes"]) > 20


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
