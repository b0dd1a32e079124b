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


def test_turn_undo_reload_save(browser: Any, shown: Page, tmp_path: Path) -> None:
    with opened(browser, shown, f"{shown.address}#action", accept_downloads=True) as tab:
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
        mass = tab.get_by_role("spinbutton", name="mass of the hammer, change in g")
        assert mass.input_value() == "0"
        mass.fill("8.26")
        until(tab, f"Math.abs(parseFloat({HAMMER}) - {turned[1]}) > 0.01")
        heavy = speed(tab)[1]
        assert heavy < turned[1]
        with tab.expect_download() as download:
            tab.get_by_role("button", name="Save as TOML").click()
        download.value.save_as(tmp_path / "mine.toml")
        saved = model.load_action(tmp_path / "mine.toml")
        assert saved["hammer.mass"] == pytest.approx(0.02)
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


def test_what_the_technicians_step_does(browser: Any, shown: Page) -> None:
    with opened(browser, shown, f"{shown.address}#action?action=hirschkorn2004-regulated") as tab:
        tab.locator("main[data-ready]").wait_for()
        tab.get_by_role("button", name="What does it do?").nth(4).press("Enter")
        row = tab.locator("#step tr[aria-selected=true]")
        row.wait_for()
        assert row.locator("th").inner_text().startswith("let-off")
        assert float(row.locator("td").nth(3).inner_text().replace("+", "")) < -0.2
        tab.get_by_role("button", name="Press slowly").press("Enter")
        tab.get_by_text("down weight").wait_for()


def test_choose_a_scene_and_turn_it(browser: Any, shown: Page) -> None:
    def wait(tab: Any) -> None:
        tab.locator("main[data-ready]").wait_for()

    rebound = HAMMER.replace("child(5)", "child(6)")
    with opened(browser, shown, f"{shown.address}#action") as tab:
        wait(tab)
        rigid = tab.evaluate(rebound)
        tab.locator("#choose-scene").select_option("string")
        tab.locator("#choose-beside").wait_for()
        wait(tab)
        assert tab.evaluate(rebound) != rigid
        assert tab.evaluate(rebound.replace("child(3)", "child(2)")) == rigid  # beside the whole action
        strung = tab.evaluate(rebound)
        tab.get_by_role("spinbutton", name="mass of the string, change in g").fill("4.066")
        until(tab, f"{rebound} !== '{strung}'")
        until(tab, "location.hash.includes('string.mass')")
        tab.locator("#choose-scene").select_option("motor-arm")
        tab.get_by_text("driven by torque_nm").wait_for()
        tab.locator("#choose-scene").select_option("key-whippen")
        wait(tab)
        assert tab.get_by_text("they need all bodies").is_visible()
        tab.get_by_text("A scene of your own").click()
        tab.get_by_label("Text of a scene file").fill("[string]\nmodes = 20\n")
        tab.get_by_role("button", name="Use").click()
        until(tab, "document.querySelector('[id=\"set-string.modes\"]')?.value === '0'")
        assert tab.locator('[id="set-string.modes"]').get_attribute("aria-valuetext") == "0, as given: 20"
        wait(tab)
