"""The report in a real browser: it renders, zooms, says nothing on the console, and asks the network for nothing."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium found: install chromium to look at the report in a browser"
)


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM,
            args=["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"],
        )
        yield browser
        browser.close()


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


@pytest.fixture
def opened(browser, written):
    with quietly(browser, written.files["report.html"]) as page:
        yield page


@pytest.fixture
def opened_side(browser, side_written):
    with quietly(browser, side_written.files["report.html"], color_scheme="dark") as page:
        yield page


def test_the_report_opens_and_is_no_wider_than_the_page(opened):
    page = opened
    assert page.locator("svg[data-panels]").count() == 9
    assert page.locator("svg[data-panels]").first.bounding_box()["height"] > 150
    assert "hirschkorn2004, 5 trials: " in page.locator("#verdict").inner_text()
    # by keyboard: the first stop is the way past the navigation, and details open without a mouse
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.locator("#events details summary").first.focus()
    page.keyboard.press("Enter")
    assert page.locator("#table-area").is_visible()
    for width in (1600, 600, 400):  # 600: what is left of 1200 at 200 %
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


PANELS = """() => [...document.querySelectorAll('svg[data-panels]')].map(svg =>
  JSON.parse(svg.dataset.panels).map(p => {
  const axes = document.getElementById(p.id), box = axes.querySelector('g[id*="-patch_"] path').getBBox();
  return {id: p.id, off: Math.max(Math.abs(box.x - p.left), Math.abs(box.x + box.width - p.right),
                                  Math.abs(box.y - p.top), Math.abs(box.y + box.height - p.bottom))};
}))"""
PEAK = """() => {
  const svg = document.getElementById('figure-force-all').querySelector('svg');
  const p = JSON.parse(svg.dataset.panels)[0];
  const path = document.querySelector(`#${p.id} g[id*="-line2d_"] > path[d*="L"][style*="stroke-width: 1.1"]`);
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
    assert page.locator("svg[data-panels]").count() == 9
    assert page.locator("#table-scores").is_visible()
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


def test_no_serious_accessibility_fault(opened):
    opened.evaluate("document.querySelectorAll('details').forEach(e => { e.open = true; })")
    found = opened.evaluate(AUDIT)
    assert found["checked"] > 500
    assert found["faults"] == []


def test_the_audit_sees_what_it_looks_for(browser):
    page = browser.new_page()
    page.set_content(
        "<h1>a</h1><h3 id=b>b</h3><p id=b style='color:#999'>pale</p><svg></svg><figure></figure><button></button>"
        "<table><tr><th>c</th></tr></table><a href='#b' tabindex=2>d</a>"
    )
    kinds = {text.split(":")[0] for text in page.evaluate(AUDIT)["faults"]}
    page.close()
    assert kinds == {
        "no language", "no title", "not one main", "image without text", "figure without caption",
        "header without scope", "table without caption or header", "control or region without name",
        "own order of tabs",
        "heading skips a level", "id twice", "contrast below 4.5",
    }  # fmt: skip


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
    opened_side.evaluate("document.querySelectorAll('details').forEach(e => { e.open = true; })")
    found = opened_side.evaluate(AUDIT)
    assert found["checked"] > 1500
    assert found["faults"] == []


def test_a_printed_page_is_white_and_cuts_nothing_off(opened_side):
    opened_side.emulate_media(media="print")
    opened_side.set_viewport_size({"width": 703, "height": 900})  # A4 less its margins
    assert opened_side.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert opened_side.evaluate("document.documentElement.scrollWidth") <= 703
    assert not opened_side.locator("form.zoom").first.is_visible()


@pytest.mark.parametrize("n_trials", [1, 2])
def test_a_session_of_few_trials_zooms_without_an_error(browser, make, tmp_path, n_trials):
    from validation import compare_session, write_report

    session, truth = make.session(tmp_path / "few", n_trials=n_trials, filmed=())
    result = compare_session(session, truth.action, keep_predictions=False, rivals=(), budget=False, suspect=False)
    file = write_report(result, tmp_path / "report").files["report.html"]
    with quietly(browser, file) as page:
        page.get_by_role("button", name="Closer").click()
        assert "Whole" not in page.locator("form.zoom output").inner_text()
