"""The report: complete in itself, escaped, readable by programs, written whole or not at all."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import re

import numpy as np
import pandas as pd
import pytest

from tests.validation.report.conftest import HOSTILE
from validation import InputError, validate_session, write_report
from validation import compare as compare_session
from validation.conventions import BODIES
from validation.curves.display_signs import degrees, rotation_label
from validation.curves.style import decimate
from validation.events.definitions import EVENTS
from validation.numbers import number, with_u
from validation.report.figures.measured import rotation_of_all_trials
from validation.report.figures.overlays import model_against_trial
from validation.report.files import write_files
from validation.report.overview import forest, verdict_parts
from validation.report.page import cannot_claim, render_html, section_tables
from validation.report.view import SessionView
from validation.side_by_side import present_alone
from validation.verdict.verdict import ANOTHER_FALL


@pytest.fixture(scope="module")
def page(written):
    return written.files["report.html"].read_text(encoding="utf-8")


def test_the_page_has_no_outside_address_and_runs_its_own_script_only(page, written):
    assert not re.search(r"(https?:)?//[a-z]", page, re.I)
    scripts = re.findall(r"<script>(.*?)</script>", page, re.S)
    assert len(scripts) == page.count("<script") == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'" in page
    assert "@import" not in page
    beside = set(re.findall(r'(?:href|src)="(?!#|data:)([^"]*)"', page))
    assert beside <= set(written.files)  # every link leads to a file of this report
    assert {"results.json", "curves.nc", "curves/hammer.csv", "tables/quantities.csv"} <= beside
    assert page.startswith("<!DOCTYPE html>")
    assert '<html lang="en">' in page


@pytest.mark.parametrize("report", ["written", "side_written"])
def test_every_id_is_unique_and_every_reference_has_one(report, request):
    page = request.getfixturevalue(report).files["report.html"].read_text(encoding="utf-8")
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    references = set(re.findall(r'href="#([^"]+)"', page)) | set(re.findall(r"url\(#([^)]+)\)", page))
    references |= {i for group in re.findall(r'aria-labelledby="([^"]+)"', page) for i in group.split()}
    assert references <= set(ids)


def test_every_figure_of_the_thesis_is_there_with_title_and_description(page):
    shown = re.findall(r'<figure id="figure-([a-z-]+)"', page)
    assert shown[:8] == ["force-one", *(f"{body}-model" for body in BODIES), "force-motion", "force-all"]
    assert shown[8:] == ["key-all", "whippen-all", "hammer-all"]
    for figure in ("3.9", "3.10", "3.11", "3.12", "3.13", "4.1", "4.2", "4.3", "4.4"):
        assert f"As thesis {figure}" in page
    figures = len(re.findall("<svg [^>]*data-panels", page))
    assert figures == len(shown) == 11
    assert page.count("<desc") == figures + 5  # the five angles of the first screen
    assert len(page.encode()) < 1_200_000


def test_words_are_set_to_the_left_and_numbers_to_the_right(page):
    (table,) = re.findall(r'<table id="table-trials-events".*?</table>', page, re.DOTALL)
    head = re.findall(r'<th scope="col"(?: class="(\w+)")?>([^<]+)', table)
    assert head[:5] == [("", "trial"), ("word", "source"), ("word", "event"), ("", "value"), ("word", "status")]
    assert '<td class="word">String impact (ms)</td><td>' in table


def test_the_verdict_comes_first_and_limits_and_provenance_are_there(page, compared):
    lead, rest = verdict_parts(compared)
    first, table, folded = page.index(lead), page.index("<table"), page.index("<details")
    assert first < page.index('class="five"') < table < folded
    assert "±" in lead and "°" in lead + rest and page.count(lead) == 1
    assert page.count(compared.advice[0]) == 1
    assert "What this report cannot claim" in page
    assert "action.values_sha256" in page
    assert all(seal in page for seal in compared.trials["seal"])
    assert f"{compared.window.start_s:.4f} s" in page
    assert "5 trials: sᵣ is known only to within a factor" in page


QUICK = {"rivals": (), "budget": False, "explain": False}
"""What these tests do not look at."""


@pytest.mark.usefixtures("without_figures")
def test_curves_of_an_older_report_do_not_stay_beside_a_new_one(lonely, tmp_path):
    (tmp_path / "curves").mkdir()
    older = ("curves_1.nc", "curves_2.nc", "curves/s2-hammer.csv", "curves/jack.json", "curves/key.csv")
    for name in (*older, "curves/mine.csv", "curves_of_mine.nc"):
        (tmp_path / name).write_text("older")
    written = write_report(lonely[1], tmp_path).files
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()} - set(written)
    assert left == {"curves/mine.csv", "curves_of_mine.nc"} and written["curves/key.csv"].read_text() != "older"


def test_text_from_a_session_is_escaped(lonely):
    _, result = lonely
    text = result.files["report.html"].read_text(encoding="utf-8")
    assert text.count("<script") == 1
    assert "&lt;script&gt;alert(" in text
    assert json.loads(result.files["results.json"].read_text(encoding="utf-8"))["results"][0]["session"] == HOSTILE


def test_results_json_has_no_nan_and_the_same_numbers(compared, written):
    text = written.files["results.json"].read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in results.json"))
    assert (content["schema"], content["schema_version"]) == ("piano-action-rig results", 8)
    assert content["results"][0]["verdict_lines"] == compared.verdict_lines
    assert (content["results"][0]["outcome"], content["results"][0]["sentence"]) == (
        compared.outcome,
        compared.sentence,
    )
    assert set(content["event_definitions"]) == set(EVENTS)
    first = content["tables"]["scores"][0]
    assert first["rmse_rad"] == compared.scores["rmse_rad"].iloc[0]
    jack = next(row for row in content["tables"]["channels"] if row["channel"] == "jack")
    assert jack["s_r_rad"] is None
    assert jack["state"] == "one trial"
    for name, table in compared.tables.items():
        back = pd.read_csv(io.StringIO(written.files[f"tables/{name}.csv"].read_text(encoding="utf-8")))
        assert list(back.columns) == ["session", "model", *table.columns]
        assert len(back) == len(table)
        assert len(content["tables"][name]) == len(table)


def test_a_folder_that_cannot_be_written_leaves_nothing(compared, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(InputError, match="is a file; name a folder"):
        validate_session("unused", out=blocked / "below")
    with pytest.raises(InputError, match="is a file; name a folder"):
        write_report(compared, blocked / "below")
    with pytest.raises(InputError, match="cannot be written"):
        write_files(blocked / "below", {"a.txt": "a"})
    target = tmp_path / "out"
    (target / "report.html").mkdir(parents=True)
    with pytest.raises(InputError, match="cannot be written"):
        write_files(target, {"tables/scores.csv": "a", "report.html": "b"})
    assert sorted(p.name for p in target.rglob("*")) == ["report.html"]
    assert blocked.read_text() == "in the way"


def test_older_files_are_replaced_together(tmp_path):
    write_files(tmp_path, {"a.txt": "old", "b/c.txt": "old"})
    files = write_files(tmp_path, {"a.txt": "new", "b/c.txt": "neu\n"})
    assert files["a.txt"].read_text() == "new"
    assert files["b/c.txt"].read_bytes() == b"neu\n"
    assert not list(tmp_path.rglob("*.part"))


def test_one_trial_and_no_film_are_said(lonely):
    session, result = lonely
    text = result.files["report.html"].read_text(encoding="utf-8")
    assert result.files["report.html"].parent == session.path
    assert "repeatability is not known" in text
    assert "<td>0 (not filmed)</td>" in text
    assert any("not filmed: nothing is said" in limit for limit in cannot_claim(present_alone(result)))
    assert np.isnan(result.channels["s_r_rad"].astype(float)).all()
    assert "against 1 trial of" in result.verdict


def test_a_blow_too_soft_for_the_string_and_a_film_without_a_frame_are_reported(make, tmp_path, without_figures):
    session, truth = make.session(tmp_path / "s", n_trials=1, filmed=(1,), strength=(0.06,))
    table, _ = session.read_derived("angles", 1)
    table["jack_relative_rad"] = np.nan
    session.write_derived("angles", 1, table)
    result = compare_session(session, truth.action, **QUICK)
    assert "Neither in the records nor in the model: let-off, string impact, hammer speed at impact" in result.verdict
    channels = result.channels.set_index("channel")
    assert channels.loc["jack", "state"] == "no frame tracked"
    assert np.isnan(channels.loc["jack", "rmse_rad"])
    assert np.isfinite(channels.loc["repetition", "rmse_rad"])
    assert "1 (no frame tracked)" in render_html(present_alone(result))


def test_a_session_without_trials_and_a_missing_one_are_refused_in_one_line(make, tmp_path):
    from rig.errors import RigInputError
    from rig.session import Session

    empty = Session.create(tmp_path / "empty", make.info())
    for path in (empty.path, tmp_path / "nowhere"):
        with pytest.raises(RigInputError) as caught:
            validate_session(path)
        assert "\n" not in str(caught.value)
        assert caught.value.exit_code == 2
    with pytest.raises(InputError, match="no usable trial"):
        compare_session(empty, "hirschkorn2004")
    assert not (empty.path / "report.html").exists()


def test_lost_film_frames_are_left_out_and_counted(compared):
    scores = compared.scores.set_index(["trial", "channel"])
    assert scores.loc[(2, "jack"), "n_lost"] == 3
    assert np.isfinite(scores.loc[(2, "jack"), "rmse_rad"])
    assert any("jack lost in 3 of 1600 frames" in text for text in compared.warnings)


def test_figures_have_the_signs_of_the_thesis():
    change = np.radians([0.0, 2.0])
    assert degrees("key", change)[1] == pytest.approx(-2.0)
    assert degrees("whippen", change)[1] == pytest.approx(2.0)
    assert degrees("hammer", change)[1] == pytest.approx(-2.0)
    assert rotation_label("jack") == r"$\theta_j(0) - \theta_j$ (°)"
    assert rotation_label("whippen") == r"$\theta_w - \theta_w(0)$ (°)"


def test_thinning_keeps_every_spike_and_every_gap():
    time = np.arange(100_000) * 1e-4
    values = np.sin(time)
    values[54_321] = 9.0
    values[777] = -9.0
    values[40_000:40_500] = np.nan
    t, v = decimate(time, values)
    assert t.size <= 2 * 560
    assert np.nanmax(v) == 9.0
    assert np.nanmin(v) == -9.0
    assert np.all(np.diff(t) >= 0)
    assert np.isnan(v[(t > 4.002) & (t < 4.048)]).all()
    short = decimate(time[:50], values[:50])
    np.testing.assert_array_equal(short[1], values[:50])


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (2.35123, 0.0021, "2.3512 ± 0.0021"),
        (-0.05, 0.2, "−0.05 ± 0.20"),
        (float("nan"), 1.0, "–"),
        (12.3456, 0.0, "12.35"),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value, u, text):
    assert with_u(value, u) == text


def test_overlays_show_bands_and_the_lifts_that_are_left_out(compared):

    lift = {"trial": 1, "channel": "key", "start_s": 0.30, "end_s": 0.31}
    marked = pd.DataFrame([lift]).reindex(columns=compared.marked.columns)

    def drawn(channel, marked):
        return model_against_trial(SessionView((compared.with_tables(marked=marked),)), channel)

    shaded, without = drawn("key", marked), drawn("key", marked[:0])
    assert "1 interval, 10.0 ms in all" in shaded.caption
    assert "repeatability limit at most 0." in shaded.caption
    assert "95 % interval of the mean difference at most ±0." in shaded.caption
    assert "left out: key may lift" in shaded.svg
    assert "left out" not in without.svg
    assert drawn("hammer", marked).svg == drawn("hammer", marked[:0]).svg
    # a lift of another trial alone is hatched in the residuals, and said in the legend
    assert "left out: key may lift" in drawn("key", marked.assign(trial=2)).svg
    # of each panel: the band as a filled shape; above, the limit that follows the chosen trial
    assert (
        shaded.svg.count('fill-opacity="0.35" vector-effect')
        == shaded.svg.count('fill-opacity="0.5" vector-effect')
        == 1
    )
    assert shaded.svg.count('id="key-model-limit"') == 1


def test_a_single_trial_is_judged_but_has_no_band_of_its_own(lonely):
    _, result = lonely
    view = SessionView((result,))
    every, model = rotation_of_all_trials(view, "key"), model_against_trial(view, "key")
    assert 'fill-opacity="0.35"' not in every.svg
    assert "Shaded above" not in model.caption and "Shaded" not in every.caption
    assert "95 % interval of the mean difference" in model.caption and result.judgement["trials"] == [1]


def test_an_animation_beside_the_page_is_linked_and_otherwise_said_how_to_make(compared, tmp_path, without_figures):
    assert 'href="animation.html"' not in render_html(present_alone(compared))
    (tmp_path / "animation.html").write_text("<p>moves</p>")
    page = write_report(compared, tmp_path).files["report.html"].read_text(encoding="utf-8")
    assert '<a href="animation.html">Animation of the action</a>' in page and "--animation REPORT" not in page


def test_every_table_gives_a_quantity_the_same_interval(compared):
    (table,) = (t for t in section_tables(SessionView((compared,)), "scores") if t.source == "quantities")
    interval, reading = table.head.index("model error, 95 %"), table.head.index("reading")
    rows = {row[0]: row for row in table.rows}
    drawn = forest([compared])
    assert drawn is not None
    assert {row.cells[0] for row in drawn.rows} >= {"let-off (mm)", "check height (mm)", "hammer speed at impact (m/s)"}
    for row in drawn.rows:
        assert row.cells[1] == rows[row.cells[0]][interval]
        assert row.cells[3] in (rows[row.cells[0]][reading], "for information")
        assert row.low <= row.at <= row.high


def test_another_fall_of_the_hammer_is_said_and_not_drawn(compared):
    told = compared.quantities.copy()
    told.loc[told["quantity"] == "drop", ["low", "high", "state"]] = math.nan, math.nan, ANOTHER_FALL
    drawn = forest([compared.with_tables(quantities=told)])
    assert drawn is not None
    (row,) = (row for row in drawn.rows if row.cells[0] == "drop (ms)")
    assert row.cells[1:] == ["–", "–", ANOTHER_FALL] and not row.is_known


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (4.6e-22, "0"),
        (-1e-12, "0"),
        (-0.0, "0"),
        (0.00123456, "0.00123"),
        (-12.345, "−12.3"),
        (True, "–"),
        (math.inf, "–"),
    ],
)
def test_a_number_has_three_digits_and_no_minus_before_nothing(value, text):
    assert number(value) == text
    assert with_u(-0.001, 0.2) == "0.00 ± 0.20"
