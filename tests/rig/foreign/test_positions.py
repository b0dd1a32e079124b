"""Recordings of positions: displacement by ruler points, cut into strokes, no force; anything doubtful is refused."""

from __future__ import annotations

import dataclasses
import gzip

import numpy as np
import pytest

from rig import ChannelInfo, InputError, Session, import_session, load_mapping
from rig.configuration.rig_file import ChannelConfig
from rig.foreign.mapping import parse_mapping
from rig.foreign.session_import import cut_strokes
from rig.session.info import RulerInfo
from rig.session.ruler import ABOVE, BELOW, position_of, ruler_curve
from rig.session.trial_export import list_columns
from tests.command_line import run
from validation.measurement.measure_session import BY_RULER, list_usable_trials
from validation.measurement.position_sensors import reference_turns
from validation.measurement.positions import measure_positions

RATE = 2000.0
RULER_M = np.linspace(0.0, 0.010, 11)


def sensor(displacement_m):
    """Reading of a sensor that is far from linear."""
    return 0.05 * (np.exp(3.0 * np.asarray(displacement_m) / 0.010) - 1.0)


def points(values) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in values) + "]"


def mapping(reading=None, more="", limits="") -> str:
    text = 'schema = "piano-action-rig mapping 1"\nsimulated = true\nmains_frequency_hz = 60.0\n[time]\nchannel = "t"\n'
    text += more
    for name, body in (("key", "key"), ("hammer", "hammer")):
        text += f"""
[[positions]]
name = "{name}"
channel = "{name}_adc"
offset = 0.2
gain = 0.5
u_noise = 1e-4
{limits}
[positions.ruler]
body = "{body}"
sensor_at = "back of the {name}"
calibrated_at = "front of the {name}"
reading = {points(sensor(RULER_M) if reading is None else reading)}
displacement_m = {points(RULER_M)}
u_displacement_m = 1e-4
u_reading = 2e-4
"""
    return text


def strokes(time_s, starts, length_s=0.4):
    """Displacement of strokes of 8 mm."""
    x = np.zeros_like(time_s)
    for start in starts:
        inside = (time_s >= start) & (time_s < start + length_s)
        x[inside] = 0.008 * np.sin(np.pi * (time_s[inside] - start) / length_s) ** 2
    return x


def write(path, key_m, hammer_m, time_s, seed=0):
    noise = 1e-5 * np.random.default_rng(seed).standard_normal((time_s.size, 2))
    table = np.column_stack([time_s, 0.2 + 0.5 * sensor(key_m), 0.2 + 0.5 * sensor(hammer_m)])
    table[:, 1:] += 0.5 * noise
    np.savetxt(path, table, delimiter=",", header="t,key_adc,hammer_adc", comments="", fmt="%.9f")
    return path


@pytest.fixture
def recording(tmp_path):
    """Three strokes by a clock that begins at 36 s."""
    time_s = 36.0 + np.arange(int(4 * RATE)) / RATE
    x = strokes(time_s, (36.6, 37.8, 38.9))
    return write(tmp_path / "long.csv", x, 0.9 * x, time_s), x


def measured_strokes(session):
    """The strokes that can be compared, and by number why others cannot."""
    return list_usable_trials(session, lambda trial, data: measure_positions(data, BY_RULER, trial.sha256))


def import_text(tmp_path, text, file):
    return import_session(tmp_path / "out", [file], parse_mapping(text))


def test_strokes_become_trials_with_true_displacement(recording, tmp_path) -> None:
    file, x = recording
    session = import_text(tmp_path, mapping(), file)
    assert len(session.trials) == 3
    for trial, start in zip(session.trials, (36.6, 37.8, 38.9), strict=True):
        data = trial.read()
        at = float(data.provenance["source_start_s"])
        assert start - 0.4 < at < start
        first = round((at - 36.0) * RATE)
        key = data.position("key")
        error = key.displacement_m - x[first : first + data.n_valid]
        assert np.abs(error).max() < 2.5 * np.hypot(key.u_calibration_m, key.u_noise_m).max()
        assert np.abs(error).max() < 1.5e-4
        assert key.ruler.sensor_at == "back of the key" and key.ruler.calibrated_at == "front of the key"


def test_no_force_channel_is_written_or_shown(recording, tmp_path, capsys) -> None:
    session = import_text(tmp_path, mapping(), recording[0])
    data = session.trial(1).read()
    assert not data.has_force and np.isnan(data.raw_force_n).all()
    import h5py

    with h5py.File(session.trial(1).path) as file:
        assert "force" not in file["daq"] and "force_raw" not in file["daq"]
        assert {"key", "hammer"} <= set(file["daq"])
    names = [column.name for column in list_columns(data)]
    assert "force_n" not in names and {"key_m", "key_u_m", "key_flag"} <= set(names)
    assert run("info", str(session.path)) == 0
    out = capsys.readouterr().out
    assert "not recorded" in out and "key, hammer" in out


def test_command_says_what_it_cut(recording, tmp_path, capsys) -> None:
    (tmp_path / "m.toml").write_text(
        mapping(more="[[strokes.episodes]]\nfrom_s = 37.5\nto_s = 38.5\ncondition = 'soft'\nreject = 'by hand'\n")
    )
    args = ["import", str(recording[0]), "--mapping", str(tmp_path / "m.toml"), "--out", str(tmp_path / "s")]
    assert run(*args) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "soft; rejected: by hand" in lines[1] and "no force" in lines[0]
    assert Session.open(tmp_path / "s").trial(2).rejected == "by hand"


def test_reading_beyond_the_ruler_is_flagged_and_held() -> None:
    ruler = RulerInfo("key", "a", "b", tuple(sensor(RULER_M)), tuple(RULER_M), 1e-4, 1e-4)
    top = float(sensor(RULER_M[-1]))
    reading = np.array([-0.01, -1e-4, 0.1, top + 1e-4, top + 0.02])
    found = position_of("key", ruler, np.arange(5.0), reading, 1e-4)
    assert found.flag.tolist() == [BELOW, 0, 0, 0, ABOVE]
    assert found.displacement_m[0] == 0.0 and found.displacement_m[-1] == RULER_M[-1]


def test_a_falling_sensor_is_read_and_flagged_the_right_way() -> None:
    reading = tuple(1.0 - sensor(RULER_M))
    ruler = RulerInfo("key", "a", "b", reading, tuple(RULER_M), 1e-4, 1e-4)
    found = position_of("key", ruler, np.arange(3.0), np.array([1.1, 1.0 - float(sensor(0.0042)), -0.5]), 1e-4)
    assert found.flag.tolist() == [BELOW, 0, ABOVE]
    assert found.displacement_m[1] == pytest.approx(0.0042, abs=5e-5)
    assert found.displacement_m[[0, 2]] == pytest.approx([0.0, RULER_M[-1]], abs=1e-15)


def test_a_ruler_read_worse_than_stated_is_judged_and_widened() -> None:
    random = np.random.default_rng(3)
    read_m = RULER_M + 4e-4 * random.uniform(-1, 1, RULER_M.size)
    ruler = RulerInfo("key", "a", "b", tuple(sensor(RULER_M)), tuple(np.sort(read_m)), 5e-5, 1e-4)
    curve = ruler_curve(ruler)
    assert "worse than stated" in curve.judgement and curve.u_m > 1e-4
    good = ruler_curve(dataclasses.replace(ruler, displacement_m=tuple(RULER_M)))
    assert "as good as stated" in good.judgement and good.u_m == 5e-5


def test_points_that_go_back_within_their_uncertainty_are_pooled() -> None:
    reading = sensor(RULER_M)
    reading[4] = reading[3] - 1e-4
    curve = ruler_curve(RulerInfo("key", "a", "b", tuple(reading), tuple(RULER_M), 1e-4, 1e-3))
    assert curve.places.size == RULER_M.size - 1 and np.all(np.diff(curve.places) > 0)


def test_ruler_points_that_are_not_monotone_are_refused(recording, tmp_path) -> None:
    reading = sensor(RULER_M)
    reading[5], reading[6] = reading[6], reading[5]
    with pytest.raises(InputError, match=r"key: ruler points are not monotone: reading .* at 6.000 mm .* goes back"):
        import_text(tmp_path, mapping(reading), recording[0])
    assert not (tmp_path / "out").exists()


def test_a_saturated_sensor_is_refused(tmp_path) -> None:
    time_s = np.arange(int(2 * RATE)) / RATE
    x = strokes(time_s, (0.6,))
    file = write(tmp_path / "s.csv", x, x, time_s)
    lines = file.read_text().splitlines()
    for k in range(1800, 1810):
        lines[k] = ",".join([lines[k].split(",")[0], "1.0", lines[k].split(",")[2]])
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"key_adc row 1800: sensor saturated.*limit 1"):
        import_text(tmp_path, mapping(limits="limits = [0.0, 1.0]"), file)


def test_a_channel_at_another_rate_is_refused(recording, tmp_path) -> None:
    lines = recording[0].read_text().splitlines()
    slow = [lines[0]] + [line if k % 2 else ",".join([*line.split(",")[:2], ""]) for k, line in enumerate(lines[1:])]
    recording[0].write_text("\n".join(slow))
    with pytest.raises(InputError, match="hammer_adc row 1"):
        import_text(tmp_path, mapping(), recording[0])


def test_a_stroke_that_is_cut_off_is_kept_and_named(tmp_path, capsys) -> None:
    time_s = np.arange(int(1.0 * RATE)) / RATE
    x = strokes(time_s, (0.7,))
    (tmp_path / "m.toml").write_text(mapping())
    file = write(tmp_path / "cut.csv", x, x, time_s)
    session = import_session(tmp_path / "out", [file], load_mapping(tmp_path / "m.toml"))
    data = session.trial(1).read()
    assert (data.status, data.reason) == ("incomplete", "the recording ends during this stroke")
    (stroke,), _ = measured_strokes(session)
    assert stroke.time_s.size == data.n_valid and "the recording ends during this stroke" in stroke.notes[0]
    begun = cut_strokes(strokes(time_s, (-0.2,))[:, None], np.array([0.01]), RATE, trigger=0.1, pre_s=0.3, rest_s=0.1)
    assert begun[0].cut_off == "the recording begins during this stroke"


@pytest.mark.parametrize("length_s", [0.1, 0.4, 1.2])
@pytest.mark.parametrize("start_s", [0.01, 0.02, 0.04, 0.062, 0.1, 0.14, 0.2, 0.29])
def test_a_stroke_soon_after_the_start_is_whole_and_begins_where_it_does(start_s: float, length_s: float) -> None:
    time_s = np.arange(int(5.0 * RATE)) / RATE
    x = strokes(time_s, (start_s, start_s + length_s + 0.5), length_s) + 0.0004  # the sensors have drifted
    share = (x - 0.0004) / 0.01
    first, second = cut_strokes(x[:, None], np.array([0.01]), RATE, trigger=0.15, pre_s=0.3, rest_s=0.12)
    assert (first.first, first.cut_off, second.cut_off) == (max(first.trigger - 600, 0), "", "")
    for cut, begin in ((first, 0), (second, round((start_s + length_s + 0.2) * RATE))):
        assert abs(cut.trigger - begin - np.argmax(share[begin:] > 0.15)) <= 1


@pytest.mark.parametrize("start_s", [0.02, 0.04, 0.062, 0.1, 0.2])
def test_a_recording_with_a_short_rest_is_compared_as_far_as_its_rest_can_be_seen(tmp_path, start_s: float) -> None:
    time_s = np.arange(int(2.5 * RATE)) / RATE
    x = strokes(time_s, (start_s, 1.2))
    session = import_text(tmp_path, mapping(), write(tmp_path / "soon.csv", x, 0.9 * x, time_s))
    seen, refused = measured_strokes(session)
    assert [stroke.number for stroke in seen] == ([1, 2] if start_s > 0.03 else [2])
    assert all("\n" not in why and "at rest" in why for why in refused.values())
    for stroke in seen:
        first = round(float(session.trial(stroke.number).read().provenance["source_start_s"]) * RATE)
        true = x[first : first + stroke.time_s.size]
        assert np.abs(stroke.sensors.key_m - true).max() < 2e-4
        u_m = stroke.u_rad[0] * stroke.sensors.key_travel_m / reference_turns()[0]
        assert 1e-4 < u_m < np.hypot(1e-4, 1e-4)  # the ruler's, and less than as much of the zero


@pytest.mark.parametrize(("apart_s", "trials"), [(0.2, 1), (0.35, 2)])
def test_strokes_without_rest_between_them_are_one_trial(apart_s: float, trials: int) -> None:
    time_s = np.arange(int(3 * RATE)) / RATE
    x = strokes(time_s, (0.6, 1.0 + apart_s))[:, None]
    cuts = cut_strokes(x, np.array([0.01]), RATE, trigger=0.01, pre_s=0.3, rest_s=0.12)
    assert len(cuts) == trials and all(cut.trigger - cut.first >= 0.14 * RATE for cut in cuts)


def test_a_gzipped_table_is_read_and_a_torn_one_refused(recording, tmp_path) -> None:
    file = tmp_path / "long.csv.gz"
    file.write_bytes(gzip.compress(recording[0].read_bytes()))
    session = import_text(tmp_path, mapping(), file)
    assert len(session.trials) == 3
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(InputError, match="not a whole gzip file"):
        import_session(tmp_path / "torn", [file], parse_mapping(mapping()))


@pytest.mark.parametrize(("name", "conditions"), [("long.csv", ["", "soft", ""]), ("other.csv", ["", "", ""])])
def test_episodes_of_one_recording_say_nothing_of_another(recording, tmp_path, name: str, conditions) -> None:
    file = recording[0].rename(tmp_path / name)
    more = "[[strokes.episodes]]\nfrom_s = 37.5\nto_s = 38.5\nfile = 'long.csv'\ncondition = 'soft'\n"
    session = import_text(tmp_path, mapping(more=more), file)
    assert [trial.read().condition for trial in session.trials] == conditions


def test_nothing_played_is_refused(tmp_path) -> None:
    time_s = np.arange(int(1.0 * RATE)) / RATE
    file = write(tmp_path / "still.csv", 0 * time_s, 0 * time_s, time_s)
    with pytest.raises(InputError, match=r"no stroke found.*strokes.trigger"):
        import_text(tmp_path, mapping(), file)


def test_force_and_positions_exclude_each_other() -> None:
    with pytest.raises(InputError, match="the mapping has both"):
        parse_mapping(mapping(more='[force]\nchannel = "f"\n'))
    with pytest.raises(InputError, match="the mapping has neither"):
        parse_mapping(mapping().split("\n[[positions]]")[0])


def test_a_rig_files_channel_may_be_a_position_sensor() -> None:
    ruler = {
        "body": "hammer", "sensor_at": "shank", "calibrated_at": "shank", "reading": tuple(sensor(RULER_M)),
        "displacement_m": tuple(RULER_M), "u_displacement_m": 1e-4,
    }  # fmt: skip
    config = ChannelConfig(
        name="shank", channel="Dev1/ai3", quantity="position", unit="V", sensor="s", calibration="ruler",
        electrical=(0.0, 1.0), physical=(0.0, 1.0), least=-5.0, most=5.0, ruler=ruler,
    )  # fmt: skip
    info = ChannelInfo.from_config(config)
    assert info.ruler is not None and info.ruler.displacement_m == tuple(RULER_M)
    plain = {**dataclasses.asdict(info), "electrical": [0.0, 1.0], "physical": [0.0, 1.0]}
    assert ChannelInfo.from_plain(plain) == info
    with pytest.raises(ValueError, match="displacement_m falls"):
        ChannelConfig(**{**config.model_dump(), "ruler": {**ruler, "displacement_m": tuple(RULER_M[::-1])}})


def test_drift_of_the_zero_is_taken_off_the_reading(recording, tmp_path) -> None:
    data = import_text(tmp_path, mapping(), recording[0]).trial(1).read()
    drifted = dataclasses.replace(data, channel_values=data.channel_values + 0.01)
    assert np.allclose(drifted.position("key", zero=0.01).displacement_m, data.position("key").displacement_m)
