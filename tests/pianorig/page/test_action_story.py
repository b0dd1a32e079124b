"""A user turns a screw by keyboard, sees the blow follow, takes it back, reloads, and saves the action as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import model
from tests.pianorig.page.conftest import Page
from tests.pianorig.page.stories import opened, until

HAMMER = "document.querySelector('#events tr:nth-child(5) td:nth-child(3)').textContent"
GIVEN = HAMMER.replace("child(3)", "child(2)")
BUTTON = '[id="set-contact08.second.y"]'


def speed(tab: Any) -> list[float]:
    row = tab.locator("#events tr", has_text="Hammer speed at impact")
    return [float(cell.split()[0]) for cell in row.locator("td").all_inner_texts()]


@pytest.mark.slow
def test_turn_undo_reload_save(browser: Any, looking: Page, tmp_path: Path) -> None:
    with opened(browser, looking, f"{looking.address}#action", accept_downloads=True) as tab:
        tab.locator("main[data-ready]").wait_for()
        given, now = speed(tab)
        assert given == now and tab.get_by_role("button", name="Save as TOML").is_disabled()
        tab.locator(BUTTON).focus()
        for _ in range(40):
            tab.keyboard.press("ArrowRight")
        until(tab, f"{HAMMER} !== {GIVEN}")
        until(tab, "document.querySelector('main').dataset.latency")
        until(tab, "location.hash.includes('contact08.second.y')")
        assert speed(tab)[0] == given
        tab.reload()  # what was set is in the address
        tab.locator("main[data-ready]").wait_for()
        turned = speed(tab)
        assert turned[0] == given and turned[1] != given
        tab.get_by_label("Add").fill("hammer.mass")
        tab.keyboard.press("Tab")
        mass = tab.get_by_role("spinbutton", name="hammer.mass, kg")
        mass.fill("0.02")
        until(tab, f"Math.abs(parseFloat({HAMMER}) - {turned[1]}) > 0.01")
        heavy = speed(tab)[1]
        assert heavy < turned[1]
        with tab.expect_download() as download:
            tab.get_by_role("button", name="Save as TOML").click()
        download.value.save_as(tmp_path / "mine.toml")
        saved = model.load_action(tmp_path / "mine.toml")
        assert saved["hammer.mass"] == 0.02
        assert saved["contact08.second.y"] != model.load_action("hirschkorn2004")["contact08.second.y"]
        tab.get_by_role("button", name="Undo").click()
        until(
            tab,
            f"parseFloat({HAMMER}) === {turned[1]}",
        )
        tab.get_by_role("button", name="Reset").click()
        until(
            tab,
            f"parseFloat({HAMMER}) === {given}",
        )


@pytest.mark.slow
def test_what_the_technicians_step_does(browser: Any, looking: Page) -> None:
    with opened(browser, looking, f"{looking.address}#action?action=hirschkorn2004-regulated") as tab:
        tab.locator("main[data-ready]").wait_for()
        tab.get_by_role("button", name="What does it do?").nth(4).press("Enter")
        row = tab.locator("#step tr[aria-selected=true]")
        row.wait_for()
        assert row.locator("th").inner_text().startswith("let-off")
        assert float(row.locator("td").nth(3).inner_text().replace("+", "")) < -0.2
        tab.get_by_role("button", name="Press slowly").press("Enter")
        tab.get_by_text("down weight").wait_for()
