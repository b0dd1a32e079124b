"""The built site in a browser without a network: search finds pages, nothing is fetched, pictures have words.

Run after building it:  python -m sphinx -W -b html docs docs/_build/html && python -m pytest -m slow tests/test_site.py
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

SITE = Path(__file__).parents[1] / "docs" / "_build" / "html"

pytestmark = pytest.mark.slow


@pytest.fixture
def page():
    """A page of a browser that may open files only; the addresses it asked for are kept."""
    if not (SITE / "search.html").exists():
        pytest.skip("the site is not built: python -m sphinx -W -b html docs docs/_build/html")
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    if browser_path is None:
        pytest.skip("no Chromium")
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        context = browser.new_context(offline=True)
        found = context.new_page()
        asked: list[str] = []
        found.on("request", lambda request: asked.append(request.url))
        yield found, asked
        browser.close()


@pytest.mark.parametrize(("words", "wanted"), [("let-off", "regulate"), ("contact07", "inner"), ("watchdog", "safety")])
def test_search_works_without_a_network(page, words: str, wanted: str) -> None:
    found, asked = page
    found.goto(f"{(SITE / 'search.html').as_uri()}?q={words}")
    found.wait_for_selector("ul.search li a", timeout=20_000)
    found.wait_for_timeout(1500)
    links = [link.get_attribute("href") or "" for link in found.query_selector_all("ul.search li a")]
    assert any(wanted in link for link in links), links
    assert all(url.startswith(("file:", "data:")) for url in asked), asked


def test_pages_fetch_nothing_from_a_network(page) -> None:
    found, asked = page
    for name in ("index.html", "explanation/model.html", "tutorials/first_blow.html", "howto/odd_trial.html"):
        found.goto((SITE / name).as_uri())
        assert found.title()
    assert all(url.startswith(("file:", "data:")) for url in asked), asked


def test_every_picture_has_words() -> None:
    if not SITE.exists():
        pytest.skip("the site is not built")
    for file in SITE.rglob("*.html"):
        images = re.findall(r"<img [^>]*>", file.read_text(encoding="utf-8"))
        for image in (one for one in images if "_static/" not in one):  # the theme's own signs
            words = re.search(r'alt="([^"]*)"', image)
            assert words and len(words[1]) > 20, f"{file.relative_to(SITE)}: {image}"
