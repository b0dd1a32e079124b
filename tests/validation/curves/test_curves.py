"""Curves of a result: one tidy table on one time base, the same in files, marks, plots, and what a notebook shows."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

import validation
from validation.curves.marks import trial_marks
from validation.curves.style import uneven_samples
from validation.report.figures.layout import quantiles
from validation.result import OUTCOMES


def test_the_table_is_tidy_and_holds_the_traces_on_one_base(compared):
    table = compared.to_frame()
    base = compared.spread["time_s"].to_numpy()
    assert list(table.columns) == [
        "trial", "channel", "time_s", "measured_rad", "predicted_rad", "null_rad", "u_rad", "left_out", "force_n",
    ]  # fmt: skip
    for (trial, channel), part in table.groupby(["trial", "channel"], observed=True):
        assert np.array_equal(part["time_s"], base), (trial, channel)
    hammer = table.query("trial == 3 and channel == 'hammer'").set_index("time_s")
    trace = compared.traces[3].set_index("time_s").loc[base[0] : base[-1]]
    assert np.array_equal(hammer["measured_rad"], trace["hammer_measured_rad"])
    assert np.array_equal(hammer["predicted_rad"], trace["hammer_predicted_rad"])
    jack = table.query("channel == 'jack'").groupby("trial")["measured_rad"].count()
    assert jack[2] > 0.9 * base.size and (jack.drop(2) == 0).all()
    # the mean of the trials is that of the channel table's curves
    mean = table.query("channel == 'key'").groupby("time_s")["measured_rad"].mean().to_numpy()
    assert mean == pytest.approx(compared.spread["key_mean_rad"].to_numpy(), abs=1e-12)
    assert len(compared.to_frame(trials=[1])) == (table["trial"] == 1).sum()
    with pytest.raises(validation.InputError, match="trial 9: not compared; allowed 1, 2, 3, 4, 5"):
        compared.to_frame(trials=[9])


def test_the_netcdf_file_opens_in_xarray_and_reads_back_as_the_table(compared, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    file = compared.save(tmp_path / "curves.nc")
    with xarray.open_dataset(file, engine="h5netcdf") as data:
        assert dict(data.sizes) == {"trial": 5, "channel": 5, "time": len(compared.base_s)}
        assert data.time.attrs["units"] == "s" and data.measured_rad.attrs["units"] == "rad"
        assert data.attrs["session"] == "test forte" and data.attrs["verdict"] == compared.sentence
        hammer = data.measured_rad.sel(trial=2, channel="hammer").to_series()
    table = compared.to_frame()
    own = table.query("trial == 2 and channel == 'hammer'")
    assert hammer.to_numpy() == pytest.approx(own["measured_rad"].to_numpy(), abs=1e-7)
    back = validation.read_curves(file)
    assert list(back.columns) == list(table.columns) and len(back) == len(table)
    for column in ("measured_rad", "predicted_rad", "force_n"):
        np.testing.assert_allclose(back[column], table[column], rtol=1e-6, atol=1e-7)


def test_curves_files_refuse_what_they_cannot_be(compared, tmp_path):
    with pytest.raises(validation.InputError, match=r"ending '.mat' found, allowed .nc, .csv or .parquet"):
        compared.save(tmp_path / "a.mat")
    with pytest.raises(validation.InputError, match="cannot be written"):
        compared.save(tmp_path / "nowhere" / "a.nc")
    other = tmp_path / "other.nc"
    other.write_bytes(b"no")
    with pytest.raises(validation.InputError, match="no curves file"):
        validation.read_curves(other)


def test_parquet_is_written_or_its_extra_named(compared, tmp_path):
    small = replace(compared, traces={1: compared.traces[1]}, film_traces={})
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        with pytest.raises(validation.InputError, match=r"pip install piano-action-rig\[parquet\]"):
            small.save(tmp_path / "a.parquet")
    else:
        file = small.save(tmp_path / "a.parquet")
        assert len(pd.read_parquet(file)) == len(small.to_frame())


def test_a_b_c_stand_where_the_thesis_puts_them(compared, recorded):
    _, truth = recorded
    marks = {mark.label: mark.time_s for mark in compared.marks(1)}
    events = compared.events.query("trial == 1 and source == 'trial'").set_index("event")["value"]
    assert marks["A"] == events["key_bottom"] and marks["string impact"] == events["string_impact"]
    # B: the force of the blow ends 0.36 s after it begins, at 0.40 s; 2 % of the peak is reached a little before
    assert 0.70 < marks["B"] < 0.76
    key = -(truth.angle_rad[1][:, 0] - truth.rest_rad[0])
    after = truth.time_s > events["key_release"]
    late, time = key[after], truth.time_s[after]
    i = int(np.searchsorted(time, marks["C"]))
    assert late[i] < 0.05 * key.max() and late[i - 200] > late[i] < late[i + 40 : i + 400].max()
    assert marks["A"] < events["check_time"] < marks["B"] < marks["C"]


def test_a_blow_that_is_never_released_has_no_b_and_no_c():
    time = np.arange(0, 1, 1e-3)
    frame = pd.DataFrame(
        {"time_s": time, "force_time_s": time, "force_n": np.minimum(time, 0.5), "key_measured_rad": -time}
    )
    events = pd.DataFrame({"event": ["key_bottom"], "value": [0.4], "status": ["found"]})
    assert [mark.label for mark in trial_marks(frame, events)] == ["A"]


def test_b_is_no_later_bounce_of_the_motor_arm_and_waits_for_a_force_that_lingers():
    time = np.arange(0, 1.2, 1e-3)
    hold = 10.0 * ((time > 0.1) & (time < 0.6))
    key = -np.interp(time, [0.1, 0.15, 0.6, 0.8, 0.82], [0, 1, 1, 0, 0.1])
    frame = pd.DataFrame({"time_s": time, "force_time_s": time, "force_n": hold, "key_measured_rad": key})
    events = pd.DataFrame({"event": ["key_release"], "value": [0.7], "status": ["found"]})

    def b(force):
        return {m.label: m.time_s for m in trial_marks(frame.assign(force_n=force), events)}["B"]

    assert b(hold) == pytest.approx(0.599)
    assert b(hold + 1.0 * ((time > 1.0) & (time < 1.01))) == pytest.approx(0.599)
    assert b(10.0 * ((time > 0.1) & (time < 0.75)) + (time > 1.0) * (time < 1.01)) == pytest.approx(0.749)


def test_a_notebook_shows_the_verdict_first(compared):
    assert compared.outcome in OUTCOMES
    assert compared.sentence in " ".join(repr(compared).split()) and repr(compared).count("\n") < 12
    assert compared.sentence in compared.verdict_lines[0]
    page = replace(compared, session_name="<b>")._repr_html_()
    assert compared.sentence in page and "&lt;b&gt;" in page and "<b>" not in page


@pytest.mark.parametrize("channel", ["key", "whippen", "hammer", "jack", "force"])
def test_a_plot_shows_the_trial_and_its_marks(compared, channel):
    top = compared.plot(channel)
    plt.close(top.figure)
    assert [text.get_text() for text in top.texts] == ["A", "B", "C"]
    assert len(top.figure.axes) == (1 if channel == "force" else 2)
    own = plt.figure().subplots()
    assert compared.plot(channel, ax=own) is own and len(own.figure.axes) == 1
    assert own.get_title(loc="left") == top.get_title(loc="left")
    plt.close(own.figure)
    if channel == "hammer":
        drawn = next(line for line in top.lines if line.get_label() == "trial")
        rotation = -np.degrees(compared.traces[1]["hammer_measured_rad"])
        assert np.nanmax(drawn.get_ydata()) == pytest.approx(rotation.max(), rel=1e-9)


def test_a_plot_that_cannot_be_drawn_says_why(compared):
    with pytest.raises(validation.InputError, match="channel 'damper': allowed key, whippen, jack"):
        compared.plot("damper")
    with pytest.raises(validation.InputError, match=r"jack: trial 1 was not filmed; filmed: \[2\]"):
        compared.plot("jack", trial=1)
    with pytest.raises(validation.InputError, match="trial 12: not compared"):
        compared.plot("key", trial=12)


def test_uneven_samples_are_dense_where_a_curve_bends():
    time = np.linspace(0, 1, 5001)
    curve = 1 / (1 + np.exp(-(time - 0.5) / 0.002))
    at = uneven_samples(time, curve[:, None], 300)
    assert at[0] == 0 and at[-1] == 5000 and at.size <= 300 and (np.diff(at) > 0).all()
    drawn = np.interp(time, time[at], curve[at])
    even = np.interp(time, time[::17], curve[::17])
    assert np.abs(drawn - curve).max() < 0.01 < np.abs(even - curve).max()


def test_quantiles_are_numpys_and_leave_lost_values_out():
    rng = np.random.default_rng(2)
    curves = rng.normal(size=(50, 23))
    curves[7, 3:] = np.nan
    curves[8] = np.nan
    time_s, values = quantiles(np.arange(50.0), curves)
    assert time_s.size == 50
    expected = np.quantile(curves[0], [0.05, 0.25, 0.5, 0.75, 0.95])
    np.testing.assert_allclose(values[0], expected)
    np.testing.assert_allclose(values[7], np.quantile(curves[7, :3], [0.05, 0.25, 0.5, 0.75, 0.95]))
    assert np.isnan(values[8]).all()
