"""A user in front of the page: what the browser says on its console or asks of the network fails the story."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.pianorig.page.conftest import Page

LOUD = ("error", "warning")
HINT = "willReadFrequently"
"""A browser's advice about reading pictures back, which only a test does."""


@contextmanager
def opened(browser: Any, page: Page, first: str | None = None, **options: Any) -> Iterator[Any]:
    """The page in a tab of its own context; silent on the console, to itself on the network, without dialogs."""
    problems: list[str] = []
    asked: list[str] = []
    context = browser.new_context(viewport={"width": 1280, "height": 900}, **options)
    tab = context.new_page()
    tab.on("console", lambda said: problems.append(said.text) if said.type in LOUD and HINT not in said.text else None)
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on("dialog", lambda dialog: problems.append(f"dialog {dialog.message}"))
    tab.on("request", lambda request: asked.append(request.url))
    tab.set_default_timeout(30_000)
    tab.goto(first or page.address)
    try:
        yield tab
    finally:
        context.close()
    assert problems == []
    assert [url for url in asked if not url.startswith((page.address, "data:", "blob:"))] == []


def until(tab: Any, condition: str, turns: int = 1500) -> None:
    """Wait until something holds in the page, 20 ms a turn; Playwright's own wait needs a forbidden ``eval``."""
    for _ in range(turns):
        if tab.evaluate(condition):
            return
        tab.wait_for_timeout(20)
    raise AssertionError(f"never: {condition}")
