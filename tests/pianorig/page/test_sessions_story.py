"""A user finds a session, reads its report, rejects a trial with a reason, and reloads; all in a real browser."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from rig import Session
from tests.pianorig.page.conftest import EXAMPLE, Page, serve
from tests.pianorig.page.stories import opened

ESCAPE = """<!DOCTYPE html><title>r</title><p id=told></p><script>
const tell = (text) => { document.getElementById("told").textContent += text; };
try { top.document.title; tell("parent read "); } catch { tell("parent closed "); }
try { document.cookie = "a=b"; tell("cookie "); } catch { tell("no cookie "); }
try { localStorage.length; tell("storage "); } catch { tell("no storage "); }
</script>"""


def add(folder: Path, name: str, report: str = "") -> None:
    shutil.copytree(EXAMPLE, folder / name, ignore=shutil.ignore_patterns("derived"))
    if report:
        (folder / name / "report.html").write_text(report)


def test_find_read_reject_reload(browser: Any, folder: Path) -> None:
    add(folder, "second", ESCAPE)
    add(folder, "<img src=x onerror=alert(1)>")
    for page in serve(folder, control=True):
        with opened(browser, page, page.address) as tab:
            rows = tab.locator("#sessions tbody tr")
            rows.nth(2).wait_for()
            assert "may write" in tab.locator("#rights").inner_text()
            tab.get_by_label("Search").fill("second forte")
            assert rows.count() == 1
            tab.reload()  # search and choice are in the address
            rows.first.wait_for()
            assert rows.count() == 1 and tab.get_by_label("Search").input_value() == "second forte"
            rows.first.get_by_role("link").press("Enter")
            tab.locator("#chosen").wait_for()
            tab.get_by_role("button", name="Show report").click()
            told = tab.frame_locator("iframe.report").locator("#told")
            told.get_by_text("no storage").wait_for()
            assert told.inner_text().strip() == "parent closed no cookie no storage"
            tab.get_by_label("About").select_option("2")
            tab.get_by_label("What").select_option("reject")
            tab.get_by_label("Author").fill("ana")
            tab.get_by_label("Text or reason").fill("cable <b>touched</b> the whippen")
            tab.reload()  # nothing that was typed is lost
            assert tab.get_by_label("Text or reason").input_value() == "cable <b>touched</b> the whippen"
            assert tab.get_by_label("About").input_value() == "2"
            tab.get_by_role("button", name="Write").press("Enter")
            tab.locator("#trials").get_by_text("rejected: cable <b>touched</b> the whippen").wait_for()
            rows.first.get_by_text("3, 1 rejected").wait_for()
    assert Session.open(folder / "second").trial(2).rejected == "cable <b>touched</b> the whippen"


def test_sorting_by_keyboard(browser: Any, folder: Path, looking: Page) -> None:
    add(folder, "another")
    Session.open(folder / "another").annotate(1, "reject", "x")
    with opened(browser, looking) as tab:
        names = tab.locator("#sessions tbody th")
        names.nth(1).wait_for()
        head = tab.locator("#sessions thead").get_by_role("button", name="Session")
        head.focus()
        tab.keyboard.press("Enter")
        assert names.all_inner_texts() == ["another", "example_forte"]
        tab.keyboard.press("Enter")
        assert names.all_inner_texts() == ["example_forte", "another"]
        assert tab.locator("th[aria-sort=descending]").inner_text().startswith("Session")
        names.first.get_by_role("link").click()
        tab.get_by_text("This page only looks").first.wait_for()
        assert tab.get_by_role("button", name="Validate").is_disabled()
        assert tab.get_by_role("button", name="Write").count() == 0


def test_a_narrow_page_shows_trials_findings_and_verdict(browser: Any, looking: Page) -> None:
    with opened(browser, looking) as tab:
        tab.set_viewport_size({"width": 700, "height": 900})
        tab.locator("#sessions tbody tr").first.wait_for()
        shown = [head.inner_text() for head in tab.locator("#sessions thead th").all() if head.is_visible()]
        assert [text.split()[0] for text in shown] == [
            *("Session", "Recorded", "Trials", "Status", "Findings", "Verdict", "Compare")
        ]
        assert tab.evaluate("(e => e.scrollWidth - e.clientWidth)(document.querySelector('.scroll'))") == 0


def test_several_sessions_are_ticked_and_what_was_compared_is_shown(
    browser: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr(
        "pianorig.page.jobs.Jobs.begin", lambda self, subject, words: begun.append([subject, *words]) or {}
    )
    add(folder, "second")
    made = folder / "comparisons" / "2026-11-22T100000Z"
    made.mkdir(parents=True)
    (made / "report.html").write_text("<p>example_forte and second</p>")
    for page in serve(folder, control=True):
        with opened(browser, page, page.address) as tab:
            tab.get_by_label("Compare second").check()
            tab.get_by_role("button", name="Compare ticked sessions").click()
            tab.get_by_text("tick at least two").wait_for()
            tab.get_by_label("Comparisons").get_by_role("button", name="20").press("Enter")
            tab.frame_locator("iframe.report").get_by_text("second").first.wait_for()
        page.ask("/api/comparisons", "POST", {"sessions": ["second", "example_forte"]})
    ((name, *words),) = begun
    out = str(folder / "comparisons" / name)
    assert words == ["validate", str(folder / "second"), str(folder / "example_forte"), "--out", out]
