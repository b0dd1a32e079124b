"""A user plays a plan from the page by keyboard: begins, pauses, resumes, aborts, goes on; lamps and figures follow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rig.session import Session
from tests.pianorig.page.conftest import serve
from tests.pianorig.page.stories import opened, until

TOLD = "(document.querySelector('.plan strong')?.textContent ?? '')"  # empty while the view is drawn anew


@pytest.mark.slow
def test_begin_pause_resume_abort_and_go_on(browser: Any, folder: Path) -> None:
    for page in serve(folder, control=True, backend="sim://?clock=1"):
        with opened(browser, page, page.first_address) as tab:
            tab.get_by_role("link", name="Live").click()
            tab.locator("main[data-ready]").wait_for()
            tab.get_by_label("Profile or plan").select_option("profile piano")
            tab.get_by_role("spinbutton", name="Trials").fill("3")
            tab.get_by_label("New session").fill("mine")
            tab.reload()  # what was typed is not lost
            assert tab.get_by_label("New session").input_value() == "mine"
            tab.get_by_role("button", name="Begin").press("Enter")
            until(tab, f"{TOLD}.startsWith('trial 1')")
            until(tab, "location.hash.includes('session=mine')")  # the scope follows the plan
            tab.get_by_role("button", name="Pause before the next trial").press("Enter")
            until(tab, f"{TOLD}.startsWith('paused before trial')")
            assert [trial.status for trial in Session.open(folder / "mine").trials].count("complete") >= 1
            until(tab, "document.querySelector('#last caption')?.textContent.includes('complete')")
            force = tab.locator(".lamps .lamp", has_text="Force").first.inner_text()
            assert "of 110 N" in force and "✓" in force
            tab.reload()  # the plan is still there, paused
            until(tab, f"{TOLD}.startsWith('paused before trial')")
            tab.get_by_role("button", name="Resume").press("Enter")
            until(tab, f"{TOLD}.startsWith('trial ')")
            tab.get_by_role("button", name="Abort").press("Enter")
            until(tab, f"{TOLD} === 'ended'")
            assert "outputs safe" in tab.locator(".plan").inner_text()
            until(tab, "document.querySelector('.lamps')?.textContent.includes('interrupted')")
            tab.get_by_role("button", name="Go on with mine").press("Enter")
            until(tab, f"{TOLD} === 'ended' && document.querySelector('.plan').textContent.includes('every trial')")
    statuses = [trial.status for trial in Session.open(folder / "mine").trials]
    assert statuses.count("complete") == 3 and "interrupted" in statuses


@pytest.mark.slow
def test_who_only_looks_has_no_buttons_of_a_plan(browser: Any, folder: Path) -> None:
    for page in serve(folder, control=False):
        with opened(browser, page, f"{page.address}#live") as tab:
            tab.locator("main[data-ready]").wait_for()
            until(tab, f"{TOLD} === 'no plan is played from this page'")
            assert tab.get_by_role("button", name="Abort").count() == 0
            assert tab.get_by_role("button", name="Begin").count() == 0
            tab.keyboard.press("?")
            assert "the trial ends by itself" in tab.get_by_role("dialog").inner_text()
            tab.keyboard.press("Escape")
            assert tab.get_by_role("dialog").count() == 0
