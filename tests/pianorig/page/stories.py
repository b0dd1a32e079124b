"""A user in front of the page: what the browser says on its console or asks of the network fails the story."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.pianorig.page.conftest import Page


@contextmanager
def opened(browser: Any, page: Page, first: str | None = None, **options: Any) -> Iterator[Any]:
    """The page in a tab of its own context; silent on the console, to itself on the network, without dialogs."""
    problems: list[str] = []
    asked: list[str] = []
    context = browser.new_context(viewport={"width": 1280, "height": 900}, **options)
    tab = context.new_page()
    tab.on("console", lambda message: problems.append(message.text))
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
