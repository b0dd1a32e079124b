"""Charts: every curve lies where its axes say, ticks are round, and nothing of a session becomes markup."""

from __future__ import annotations

import json
import re
from html import unescape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from validation.curves.marks import Mark
from validation.report.figures.svg import Chart, Pen, linear_ticks, log_ticks, set_math

PEN = Pen("#123456", 1.5, (2, 1), 0.5)


def paths(text: str, look: str) -> list[np.ndarray]:
    """Points of each run of the only curve that looks so."""
    (d,) = re.findall(rf' d="([^"]*)"[^>]*{look}[^>]*vector-effect', text)
    return [np.array(run.split(), dtype=float).reshape(-1, 2) for run in d.replace("Z", "").split("M")[1:]]


def placed(text: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Points of the first panel for values of x and y, by the limits and the frame that the scripts are told."""
    panel = json.loads(unescape(re.findall(r'data-panels="([^"]*)"', text)[0]))[0]
    across = panel["left"] + (panel["right"] - panel["left"]) * (x - panel["x"][0]) / np.ptp(panel["x"])
    up = panel["bottom"] - (panel["bottom"] - panel["top"]) * (y - panel["y"][0]) / np.ptp(panel["y"])
    return np.column_stack([across, up])


def test_curves_and_bands_lie_where_the_axes_say_with_a_gap_where_a_value_is_missing() -> None:
    chart = Chart(400, 300, rows=(2, 1))
    top, low = chart.panels
    x = np.linspace(1.0, 3.0, 9)
    y = np.where(x == 2.0, np.nan, 5 * x**2)
    top.line(x, y, PEN, "measured", name="trial")
    top.band(x, y - 3, y + 4, ("#abcdef", 0.4), "reach")
    top.level(-7.0, Pen("#765432"))
    low.points(x, -x, "#fedcba", 3)
    text = chart.svg("one", "A title", "A text", (0.5, 3.5))
    first, second = paths(text, 'stroke="#123456" stroke-width="1.5" stroke-dasharray="3 1.5" stroke-opacity="0.5"')
    np.testing.assert_allclose(np.vstack([first, second]), placed(text, x, y)[np.isfinite(y)], atol=0.011)
    area, _ = paths(text, 'fill="#abcdef"')
    edge = np.concatenate([placed(text, x[:4], y[:4] - 3), placed(text, x[:4], y[:4] + 4)[::-1]])
    np.testing.assert_allclose(area, edge, atol=0.011)
    ((level,),) = (paths(text, 'stroke="#765432"'),)
    np.testing.assert_allclose(level, placed(text, np.array([0.5, 3.5]), np.array([-7.0, -7.0])), atol=0.011)
    assert text.count("h0") == 9 and 'id="one-trial"' in text
    for label in ("measured", "reach"):
        assert text.count(f">{label}</text>") == 1


def test_a_spike_of_a_long_curve_is_drawn_with_few_points() -> None:
    chart = Chart(400, 200)
    values = np.zeros(100_000)
    values[54_321] = 1.0
    chart.panels[0].line(np.arange(values.size) * 1e-5, values, PEN)
    text = chart.svg("long", "", "", (0.0, 1.0))
    (points,) = paths(text, 'stroke="#123456"')
    assert len(points) <= 2000
    assert points[:, 1].min() == pytest.approx(placed(text, np.array([0.5]), np.array([1.0]))[0, 1], abs=0.011)


def test_text_of_a_session_is_no_markup_and_a_formula_of_ours_is_set() -> None:
    chart = Chart(400, 200)
    (panel,) = chart.panels
    panel.line(np.arange(3.0), np.arange(3.0), PEN, "<b>$x_1$\0</b>")
    panel.title, panel.marks, panel.has_letters = "a & b", [Mark("A", 1.0, "A: down"), Mark("drop", 9.0, "out")], True
    text = chart.svg("key", "<t>", "<d>")
    assert "&lt;b&gt;$x_1$\N{REPLACEMENT CHARACTER}&lt;/b&gt;" in text and "a &amp; b" in text and "<b>" not in text
    assert "data-panels" not in text and text.count("&lt;t&gt;") == 1
    assert '<g class="marks"><path' in text and ">A</text>" in text and ">drop<" not in text
    shown = re.sub("<[^>]*>|&#8203;", "", set_math(r"$\theta_j(0) - \theta_j$ (°)"))
    assert shown == "θj(0) − θj (°)"
    assert set_math("model − trial (°)") == "model − trial (°)"


def test_hatching_is_defined_once_for_a_chart_that_uses_it() -> None:
    chart = Chart(400, 200)
    (panel,) = chart.panels
    plain = chart.svg("a", "", "")
    panel.shade(0.2, 0.3, "left out")
    panel.shade(0.4, 0.5, "left out")
    text = chart.svg("a", "", "")
    assert "hatch" not in plain and text.count('<pattern id="a-hatch"') == 1 and text.count("url(#a-hatch)") == 3


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(1, 9))
def test_ticks_are_round_inside_the_limits_and_not_too_many(low: float, reach: float, most: int) -> None:
    high = low + reach
    found = linear_ticks(low, high, most)
    assert len(found) <= most + 1
    for value, label in found:
        assert low - 1e-8 * reach <= value <= high + 1e-8 * reach
        assert float(label.replace("−", "-")) == pytest.approx(value, rel=1e-12, abs=1e-6 * reach)


def test_ticks_of_a_logarithmic_axis_and_of_counts() -> None:
    assert [label for _, label in log_ticks(0.02, 30.0)] == ["0.1", "1", "10"]
    assert [label for _, label in log_ticks(0.15, 0.7)] == ["0.2", "0.5"]
    assert [label for _, label in linear_ticks(0.5, 3.5, 9, has_integers=True)] == ["1", "2", "3"]
    assert [label for _, label in linear_ticks(-0.3, 0.2, 5)] == ["−0.3", "−0.2", "−0.1", "0.0", "0.1", "0.2"]
