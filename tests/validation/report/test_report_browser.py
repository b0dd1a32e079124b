"""The report in a real browser: it renders, zooms, says nothing on the console, and asks the network for nothing."""

from __future__ import annotations

import re
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def quietly(browser, file, **options):
    """A page at reading width; on leaving, it must have kept silent and to itself."""
    problems, requests = [], []
    page = browser.new_page(viewport={"width": 1200, "height": 900}, **options)
    page.on("console", lambda message: problems.append(message.text))
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(file.as_uri())
    yield page
    page.close()
    assert problems == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []


UNFOLD = "document.querySelectorAll('details').forEach(e => { e.open = true; })"


@pytest.fixture
def folded(browser, written):
    with quietly(browser, written.files["report.html"]) as page:
        yield page


@pytest.fixture
def opened(folded):
    folded.evaluate(UNFOLD)
    return folded


@pytest.fixture
def opened_side(browser, side_written):
    with quietly(browser, side_written.files["report.html"], color_scheme="dark") as page:
        page.evaluate(UNFOLD)
        yield page


def test_the_report_opens_and_is_no_wider_than_the_page(folded):
    page = folded
    assert page.locator("svg[data-panels]").count() == 11
    assert page.locator(".five svg").first.bounding_box()["height"] > 150
    assert "Model error" in page.locator("#verdict").inner_text()
    # by keyboard: the first stop is the way past the navigation, and details open without a mouse
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.locator("#scores > summary").focus()
    page.keyboard.press("Enter")
    assert page.locator("#table-scores-channels").is_visible()
    for width in (1600, 600, 400):  # 600: what is left of 1200 at 200 %
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


PANELS = """() => [...document.querySelectorAll('svg[data-panels]')].map(svg =>
  JSON.parse(svg.dataset.panels).map(p => {
  const axes = document.getElementById(p.id), box = axes.querySelector('.frame').getBBox();
  return {id: p.id, off: Math.max(Math.abs(box.x - p.left), Math.abs(box.x + box.width - p.right),
                                  Math.abs(box.y - p.top), Math.abs(box.y + box.height - p.bottom))};
}))"""
PEAK = """() => {
  const svg = document.getElementById('figure-force-all').querySelector('svg');
  const p = JSON.parse(svg.dataset.panels)[0];
  const path = document.querySelector(`#${p.id} .moving path[stroke-width="0.9"]`);
  let best = null;
  for (let s = 0; s <= 4000; s++) {
    const at = path.getPointAtLength(path.getTotalLength() * s / 4000);
    if (!best || at.y < best.y) best = at;
  }
  const shown = best.matrixTransform(path.getCTM()), frame = new DOMPoint(p.left, 0).matrixTransform(svg.getCTM());
  const end = new DOMPoint(p.right, 0).matrixTransform(svg.getCTM());
  return (shown.x - frame.x) / (end.x - frame.x);
}"""


STRETCHED = """() => [...document.querySelectorAll('svg[data-panels] g[transform*=scale]')]
  .map(g => g.getAttribute('transform').split('scale')[1])"""


def test_all_overlays_zoom_together_by_keyboard(opened, compared):
    page = opened
    members = page.evaluate(PANELS)
    assert all(members)  # every figure has a panel on the common axis
    assert max(p["off"] for panels in members for p in panels) < 0.01
    window = compared.window
    trace = next(iter(compared.traces.values()))
    inside = trace[window.mask(trace["time_s"].to_numpy())]
    peak_s = float(inside["force_time_s"].iloc[int(inside["force_n"].to_numpy().argmax())])
    whole = (peak_s - window.start_s) / (window.end_s - window.start_s)
    assert page.evaluate(PEAK) == pytest.approx(whole, abs=2e-3)
    page.locator("#zoom-from").focus()
    page.keyboard.press("Control+A")
    page.keyboard.type(f"{peak_s - 0.02:.5f}")
    page.keyboard.press("Tab")
    page.keyboard.press("Control+A")
    page.keyboard.type(f"{peak_s + 0.03:.5f}")
    page.keyboard.press("Enter")
    # the largest force lies where a time axis of these limits puts it
    assert page.evaluate(PEAK) == pytest.approx(0.4, abs=0.02)
    moved = page.evaluate(STRETCHED)
    assert len(moved) == sum(len(panels) for panels in members)
    assert len(set(moved)) == 1
    labels = [float(x) for x in page.locator("#figure-force-all .zoom-ticks text").all_text_contents()]
    assert len(labels) >= 3
    assert peak_s - 0.02 <= min(labels) < max(labels) <= peak_s + 0.03
    # an end before the start is refused in words and changes nothing
    page.locator("#zoom-to").fill("0")
    page.keyboard.press("Enter")
    assert "must lie" in page.locator("#zoom-said").inner_text()
    assert page.evaluate(PEAK) == pytest.approx(0.4, abs=0.02)
    page.locator("button[data-zoom=right]").press("Enter")
    assert page.evaluate(PEAK) == pytest.approx(0.15, abs=0.02)
    page.locator("button[data-zoom=whole]").press("Space")
    assert page.evaluate(PEAK) == pytest.approx(whole, abs=2e-3)
    assert page.locator("#zoom-said").inner_text() == "Whole evaluation window."


def test_without_scripts_everything_is_readable_and_no_dead_control_is_shown(browser, written):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(written.files["report.html"].as_uri())
    assert not page.locator("#zoom").is_visible()
    assert page.locator("svg[data-panels]").count() == 11
    page.locator("#scores > summary").click()
    assert page.locator("#table-scores-channels").is_visible()
    context.close()


AUDIT = (Path(__file__).parent / "accessibility.js").read_text(encoding="utf-8")
FOCUSABLE = """() => [...document.querySelectorAll('a[href], button, input, summary, [tabindex="0"]')]
  .filter(e => e.checkVisibility()).length"""
FOCUSED = """() => {
  const e = document.activeElement, s = getComputedStyle(e);
  if (e === document.body) return null;
  if (!e.dataset.seen) e.dataset.seen = document.querySelectorAll('[data-seen]').length + 1;
  return [e.dataset.seen, s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2, e.outerHTML.slice(0, 80)];
}"""


def test_every_control_is_reached_by_tab_and_shows_its_focus(opened):
    expected = opened.evaluate(FOCUSABLE)
    reached = {}
    for _ in range(expected):
        opened.keyboard.press("Tab")
        number, visible, text = opened.evaluate(FOCUSED)
        reached[number] = text
        assert visible, text
    assert len(reached) == expected


def test_sessions_side_by_side_zoom_on_their_own_and_no_name_breaks_the_page(opened_side):
    page = opened_side
    assert page.locator("form.zoom").count() == page.locator("section.session").count() == 2
    assert all(page.locator("form.zoom").nth(i).is_visible() for i in range(2))
    page.locator("#s2-zoom-from").fill("0.45")
    page.locator("#s2-zoom-to").fill("0.50")
    page.keyboard.press("Enter")
    assert page.locator("#s2-zoom-said").inner_text() == "0.4500 s to 0.5000 s."
    assert page.locator("#s1-zoom-said").inner_text() == "Whole evaluation window."
    stretched = "s => document.querySelectorAll(`#${s} svg g[transform*=scale]`).length"
    assert page.evaluate(stretched, "s2-session") > 10
    assert page.evaluate(stretched, "s1-session") == 0
    for width in (1600, 400):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_no_serious_accessibility_fault_side_by_side_in_the_dark(opened_side):
    assert opened_side.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 22, 22)"
    found = opened_side.evaluate(AUDIT)
    assert found["checked"] > 1500
    assert found["faults"] == []


def test_a_printed_page_is_white_and_cuts_nothing_off(opened_side):
    opened_side.emulate_media(media="print")
    opened_side.set_viewport_size({"width": 703, "height": 900})  # A4 less its margins
    assert opened_side.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert opened_side.evaluate("document.documentElement.scrollWidth") <= 703
    assert not opened_side.locator("form.zoom").first.is_visible()
    larger = """() => { const size = (e) => parseFloat(getComputedStyle(e).fontSize), text = size(document.body);
      return [...document.querySelectorAll('p.files, .files a')].filter((e) => size(e) > text).length; }"""
    assert opened_side.evaluate(larger) == 0  # small print stays small


def test_a_session_of_one_trial_zooms_without_an_error(browser, lonely):
    with quietly(browser, lonely[1].files["report.html"]) as page:
        page.evaluate(UNFOLD)
        page.get_by_role("button", name="Closer").click()
        assert "Whole" not in page.locator("form.zoom output").inner_text()


def test_a_head_sorts_its_table_by_number_and_back(opened):
    head = opened.locator("#table-trials-events thead th").nth(0)
    column = "() => [...document.querySelectorAll('#table-trials-events tbody tr')].map(r => +r.cells[0].textContent)"
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    trials = opened.evaluate(column)
    assert trials == sorted(trials) and set(trials) == {1, 2, 3, 4, 5}
    head.get_by_role("button").press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert opened.evaluate(column) == trials[::-1]
    # dashes stand last in either order, numbers by value and not by text
    value = opened.locator("#table-scores-scorecard thead th").nth(2)
    for order in ("ascending", "descending"):
        value.get_by_role("button").click()
        assert value.get_attribute("aria-sort") == order
        texts = opened.locator("#table-scores-scorecard tbody tr td:nth-child(3)").all_text_contents()
        found = [float(t.replace("\u2212", "-")) for t in texts if t != "\u2013"]
        assert found == sorted(found, reverse=order == "descending")
        assert all(t == "\u2013" for t in texts[len(found) :])


def test_a_long_table_is_folded_and_paper_holds_first_screen_and_methods(folded):
    folded.locator("#trials > summary").click()
    rows = folded.locator("#table-trials-events tbody tr")
    assert rows.count() > 12 and not rows.first.is_visible()
    folded.get_by_text(f"Every event of every trial: {rows.count()} rows").click()
    assert rows.last.is_visible()
    folded.locator("#trials > summary").click()
    pages = re.findall(rb"/Type\s*/Page\b(?!s)", folded.pdf(format="A4", prefer_css_page_size=True))
    assert 1 <= len(pages) <= 6
    folded.emulate_media(media="print")
    folded.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert folded.locator("#methods dl").first.is_visible() and not folded.locator("#scores table").first.is_visible()
    assert folded.locator("#scores > summary").is_visible()  # the list of what is folded
    smallest = """() => Math.min(...[...document.querySelectorAll('body *')]
      .filter(e => e.checkVisibility() && e.children.length === 0 && e.textContent.trim() && !e.closest('svg, script'))
      .map(e => parseFloat(getComputedStyle(e).fontSize)))"""
    assert folded.evaluate(smallest) >= 9 * 96 / 72 - 0.01
    folded.evaluate("dispatchEvent(new Event('afterprint'))")


CURVE = """() => [...document.querySelectorAll('#hammer-model-trial, #hammer-model-model0')]
  .map(p => p.getAttribute('d'))"""
POINTED = """([x, y]) => {
  const svg = document.querySelector('#figure-hammer-model svg'), p = JSON.parse(svg.dataset.panels)[0];
  const at = new DOMPoint(p.left + x * (p.right - p.left), p.top + y * (p.bottom - p.top));
  const shown = at.matrixTransform(svg.getScreenCTM());
  return [shown.x, shown.y, p.x[0] + x * (p.x[1] - p.x[0])];
}"""


def test_another_trial_is_drawn_with_its_own_numbers_and_read_under_the_pointer(opened, compared):
    figure = opened.locator("#figure-hammer-model")
    figure.scroll_into_view_if_needed()
    before = opened.evaluate(CURVE)
    assert "Trial 1: RMSE" in figure.locator(".of-trial").inner_text()
    opened.locator("#trial").select_option("4")
    after = opened.evaluate(CURVE)
    assert len(after) == 2 and after[0] != before[0] and after[1] != before[1]
    scores = compared.scores.set_index(["trial", "channel"]).loc[(4, "hammer")]
    said = figure.locator(".of-trial").inner_text()
    assert f"Trial 4: RMSE {scores['rmse_rad'] * 180 / 3.141592653589793:.4f}°" in said
    for share in (0.3, 0.55):
        x, y, t = opened.evaluate(POINTED, [share, 0.5])
        opened.mouse.move(x, y)
        tip = opened.locator(".tip").inner_text().split("\n")
        trace = compared.traces[4]
        at = (trace["time_s"] - t).abs().idxmin()
        measured, predicted = (
            -180 / 3.141592653589793 * trace.loc[at, f"hammer_{kind}_rad"] for kind in ("measured", "predicted")
        )
        assert float(tip[0].split()[0]) == pytest.approx(t, abs=1e-3)
        assert float(tip[1].split(": ")[1].rstrip("°")) == pytest.approx(measured, abs=0.02)
        assert float(tip[2].split(": ")[1].split("°")[0]) == pytest.approx(predicted, abs=0.02)


def test_marks_follow_trial_and_zoom(opened, compared):
    letters = "() => [...document.querySelectorAll('#figure-key-model .marks text')].map(e => e.textContent).join('')"
    assert opened.evaluate(letters) == "ABC"
    a = next(mark.time_s for mark in compared.marks(1) if mark.label == "A")
    opened.locator("#zoom-from").fill(f"{a + 0.005:.4f}")
    opened.keyboard.press("Enter")
    assert opened.evaluate(letters) == "BC"
    title = opened.locator("#figure-key-model .marks line title").all_text_contents()
    assert any(text.startswith("B: force released completely") for text in title)


AXE = "axe_playwright_python"


AXE_RUN = """async (options) => {
  const found = await axe.run(document, options), seen = (rules) => rules.reduce((n, rule) => n + rule.nodes.length, 0);
  return {violations: found.violations.map(v => [v.id, v.nodes[0].html.slice(0, 100)]),
          passes: found.passes.length, nodes: seen(found.passes), undecided: seen(found.incomplete)};
}"""
CONTRAST = {"runOnly": ["color-contrast"]}


def test_axe_core_finds_no_violation(browser, written):
    """Of structure on the whole page, and of colours; those of the dark are audited above.

    Colours take axe ten seconds on the whole page: they are checked without the text of figures, whose background it
    cannot tell (the audit above checks it), and on three rows of each table.
    """
    axe = pytest.importorskip(AXE, reason="axe-playwright-python carries axe-core")
    script = next(Path(axe.__file__).parent.rglob("axe.min.js")).read_text(encoding="utf-8")
    page = browser.new_page(viewport={"width": 1400, "height": 900}, color_scheme="light", bypass_csp=True)
    page.goto(written.files["report.html"].as_uri())
    page.evaluate(UNFOLD)
    page.evaluate(script)
    whole = page.evaluate(AXE_RUN, {"rules": {"color-contrast": {"enabled": False}}})
    assert whole["violations"] == [] and whole["passes"] > 30
    page.evaluate("document.querySelectorAll('svg').forEach(e => e.remove())")
    page.evaluate("document.querySelectorAll('tbody tr:nth-child(n+4)').forEach(e => e.remove())")
    colours = page.evaluate(AXE_RUN, CONTRAST)
    assert colours["violations"] == [] and colours["nodes"] > 700 and colours["undecided"] == 0
    page.evaluate("document.querySelector('main').insertAdjacentHTML('beforeend', '<p style=\"color:#aaa\">pale</p>')")
    assert [rule for rule, _ in page.evaluate(AXE_RUN, CONTRAST)["violations"]] == ["color-contrast"]
    page.close()


def test_no_table_is_cut_at_1400_and_nothing_is_wider_than_a_phone(opened):
    opened.set_viewport_size({"width": 1400, "height": 1000})
    cut = """() => [...document.querySelectorAll('.scroll, .plotted')]
      .filter(e => e.scrollWidth > e.clientWidth + 1).length"""
    assert opened.evaluate(cut) == 0
    opened.set_viewport_size({"width": 390, "height": 844})
    assert opened.evaluate("document.documentElement.scrollWidth") <= 390
    forest = "() => { const e = document.querySelector('#forest .scroll'); return e.scrollWidth - e.clientWidth; }"
    assert opened.evaluate(forest) <= 1


def test_the_first_screen_holds_verdict_angles_and_events(folded):
    folded.set_viewport_size({"width": 1400, "height": 900})
    for part in ("#verdict .outcomes", ".five", "#forest table"):
        box = folded.locator(part).bounding_box()
        assert box["y"] >= 0 and box["y"] + box["height"] <= 900, part
