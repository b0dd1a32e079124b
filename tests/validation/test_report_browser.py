"""The report in a real browser: it renders, says nothing on the console, and asks the network for nothing."""

from __future__ import annotations

import shutil

import pytest

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium found: install chromium to look at the report in a browser")
def test_the_report_opens_without_errors_or_requests(written):
    api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    path = written.files["report.html"]
    problems, requests = [], []
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM,
            args=["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"],
        )
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        page.on("console", lambda message: problems.append(message.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        assert page.locator("svg[role=img]").count() == 9
        assert page.locator("svg[role=img]").first.bounding_box()["height"] > 150
        assert "Model hirschkorn2004 against 5 trials" in page.locator("#verdict").inner_text()
        # by keyboard: the first stop is the way past the navigation, and details open without a mouse
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.className") == "skip"
        summary = page.locator("#events details summary").first
        summary.focus()
        page.keyboard.press("Enter")
        assert page.locator("#table-area").is_visible()
        # nothing is wider than the page at reading width or on a narrow screen
        for width in (1200, 480):
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        browser.close()
    assert problems == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
