"""Recordings as other programs write them: imported with the numbers that went in, or refused in one line.

One blow is written in each way. The force is in steps of 2 mN and the counts are whole, so that files that keep
integers with a scale hold it exactly.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from rig import RigInputError, Session, TrialData, import_session, read_recording
from rig.foreign.mapping import parse_mapping
from rig.foreign.reading import read_force, read_segments

N, RATE_HZ = 600, 5000
TIME_S = np.arange(N) / RATE_HZ
PUSH = np.clip((TIME_S - 0.04) / 0.03, 0.0, 1.0)
FORCE_N = np.round(4000.0 * PUSH) * 2e-3
KEY = np.round(-2400 * PUSH**2) * 4
HAMMER = np.round(9400 * PUSH**2)
CHANNELS = {"time_s": TIME_S, "force_n": FORCE_N, "key": KEY, "hammer": HAMMER}
UNITS = {"time_s": "s", "force_n": "N", "key": "counts", "hammer": "counts"}
TIME = '[time]\nchannel = "time_s"\n'
MAPPING = """schema = "piano-action-rig mapping 1"
simulated = false
mains_frequency_hz = 50.0
absent_encoders = ["whippen"]
{more}
{time}
[force]
channel = "force_n"
[[encoders]]
name = "key"
channel = "key"
unit = "counts"
counts_per_revolution = 327680
sign = 1
{key}
[[encoders]]
name = "hammer"
channel = "hammer"
unit = "counts"
counts_per_revolution = 163840
sign = 1
"""


@dataclass
class Bench:
    """Writes recordings into one folder and imports them."""

    folder: Path

    def load(self, path: Path, more: str = "", time: str = TIME, key: str = "") -> list[TrialData]:
        session = import_session(
            self.folder / f"session_{len(list(self.folder.glob('session_*')))}",
            [path],
            parse_mapping(MAPPING.format(more=more, time=time, key=key)),
        )
        return [trial.read() for trial in Session.open(session.path).trials]

    def refuse(self, path: Path, words: str, **settings: str) -> None:
        with pytest.raises(RigInputError) as caught:
            self.load(path, **settings)
        assert words in str(caught.value) and "\n" not in str(caught.value)

    def csv(self, channels: dict[str, NDArray[np.float64]] | None = None, above: str = "", names: str = "") -> Path:
        columns = channels or CHANNELS
        rows = [",".join(f"{value:.10g}" for value in row) for row in zip(*columns.values(), strict=True)]
        path = self.folder / "a.csv"
        path.write_text(above + (names or ",".join(columns)) + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
        return path

    def tdms(self, *segments: tuple[slice, dict[str, object]], stamps: NDArray[np.datetime64] | None = None) -> Path:
        """Each segment with the samples and properties of its own, of the force (``force:…``) or of all channels."""
        nptdms = pytest.importorskip("nptdms")
        path = self.folder / "a.tdms"
        with nptdms.TdmsWriter(path) as writer:
            for part, stated in segments:
                objects = []
                for name in ("force_n", "key", "hammer"):
                    own = {k.removeprefix("force:"): v for k, v in stated.items() if name == "force_n" or ":" not in k}
                    values = CHANNELS[name][part]
                    objects.append(nptdms.ChannelObject("g", name, values, {"unit_string": UNITS[name], **own}))
                if stamps is not None:
                    objects.append(nptdms.ChannelObject("g", "time_s", stamps[part]))
                writer.write_segment(objects)
        return path


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def same(trial: TrialData, part: slice = slice(None)) -> None:
    """The trial holds the samples ``part`` of the blow."""
    np.testing.assert_allclose(trial.raw_force_n, FORCE_N[part], atol=1e-12)
    np.testing.assert_array_equal(trial.encoder_count, np.column_stack([KEY, HAMMER])[part])


STATED = "[time]\nsample_rate_hz = 5000.0\n"
GAP = np.r_[0:200, 260:600]
TWICE = np.r_[0:300, 220:600]


@pytest.mark.parametrize("time", [TIME, STATED])
@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (GAP, "time_s row 201: 0.052 s comes after 0.0398 s, samples are missing: 60"),
        (TWICE, "time_s row 301: 0.044 s comes after 0.0598 s, the times go back by 80 samples"),
        (np.delete(np.arange(N), 17), "time_s row 18: 0.0036 s comes after 0.0032 s, samples are missing: 1"),
    ],
)
def test_a_stated_rate_does_not_hide_the_times_in_the_file(bench: Bench, time: str, rows, words: str) -> None:
    path = bench.csv({name: values[rows] for name, values in CHANNELS.items()})
    bench.refuse(path, words, time=time)
    bench.refuse(path, 'segments = "trials" in the mapping cuts the recording there', time=time)


@pytest.mark.parametrize("time", [TIME, STATED])
def test_a_recording_with_a_gap_is_cut_into_trials_on_request(bench: Bench, time: str) -> None:
    path = bench.csv({name: values[GAP] for name, values in CHANNELS.items()})
    first, second = bench.load(path, more='segments = "trials"\nblow_start_s = 0.01', time=time)
    same(first, slice(0, 200))
    same(second, slice(260, 600))
    whole, cut = bench.load(path, more='segments = "trials"', time=time)[:2]
    assert [whole.status, cut.status] == ["incomplete", "incomplete"] and "break" in cut.reason


def test_times_of_few_digits_confirm_a_stated_rate(bench: Bench) -> None:
    coarse = {**CHANNELS, "time_s": np.round(TIME_S, 3)}
    (trial,) = bench.load(bench.csv(coarse), time=STATED)
    same(trial)
    bench.refuse(bench.csv({**coarse, "time_s": np.round(1.01 * TIME_S, 3)}), "the stated rate means", time=STATED)
    # a clock of another computer may differ by half a sample over the recording, and a column that is no clock is named
    same(bench.load(bench.csv({**CHANNELS, "time_s": TIME_S * (1 + 5e-5)}), time=STATED)[0])
    drawn = {**CHANNELS, "time_s": np.random.default_rng(1).uniform(size=N)}
    same(bench.load(bench.csv(drawn), time=STATED + 'ignore = ["time_s"]\n')[0])


@pytest.mark.parametrize(
    ("second", "words"),
    [
        ({"wf_increment": 4e-4}, "(force_n has a sample every 0.0002 s, then every 0.0004 s)"),
        ({"wf_start_time": np.datetime64("2026-03-01T12:01:00")}, "(force_n begins 60 s later)"),
        ({"force:unit_string": "lbf"}, "(force_n is in 'N', then in 'lbf')"),
        ({"wf_xunit_string": "ms"}, "2 segments; say in the mapping"),
    ],
)
def test_tdms_segments_that_state_something_else_are_not_spliced(bench: Bench, second, words: str) -> None:
    stated = {"wf_increment": 2e-4, "wf_start_time": np.datetime64("2026-03-01T12:00:00"), "wf_xunit_string": "s"}
    path = bench.tdms((slice(0, 350), stated), (slice(350, N), {**stated, **second}))
    bench.refuse(path, words, time="")
    tables = read_segments(path)
    assert [table.channel("key").size for table in tables] == [350, 250]
    first, other = (table.clocks["key"] for table in tables)
    assert first.interval_s == 2e-4
    interval_s = second.get("wf_increment", 2e-7 if "wf_xunit_string" in second else 2e-4)
    assert other.interval_s == pytest.approx(interval_s, rel=1e-12)
    assert (other.stamp_s - first.stamp_s, tables[1].units["force_n"]) == (
        60.0 if "wf_start_time" in second else 0.0,
        second.get("force:unit_string", "N"),
    )
    same(bench.load(bench.tdms((slice(0, 350), stated), (slice(350, N), stated)), time="")[0])


def test_tdms_segments_become_trials_or_one(bench: Bench) -> None:
    begun = np.datetime64("2026-03-01T12:00:00.000000")
    stated = {"wf_increment": 2e-4, "wf_start_time": begun}
    later = {**stated, "wf_start_time": begun + np.timedelta64(70_000, "us")}
    path = bench.tdms((slice(0, 350), stated), (slice(350, N), later))
    same(bench.load(path, more='segments = "join"', time="")[0])
    first, second = bench.load(path, more='segments = "trials"\nblow_start_s = 0.01', time="")
    same(first, slice(0, 350))
    same(second, slice(350, N))
    assert [first.started_utc[:22], second.started_utc[:22]] == ["2026-03-01T12:00:00+00", "2026-03-01T12:00:00.07"]
    gap = bench.tdms(
        (slice(0, 350), stated), (slice(350, N), {**later, "wf_start_time": begun + np.timedelta64(9, "s")})
    )
    bench.refuse(gap, "samples are missing", more='segments = "join"', time="")


def test_each_tdms_segment_has_its_own_scale(bench: Bench) -> None:
    def scale(slope: float) -> dict[str, object]:
        return {
            "wf_increment": 2e-4, "force:NI_Number_Of_Scales": 1, "force:NI_Scaling_Status": "unscaled",
            "force:NI_Scale[0]_Scale_Type": "Linear", "force:NI_Scale[0]_Linear_Slope": slope,
            "force:NI_Scale[0]_Linear_Y_Intercept": 0.0,
        }  # fmt: skip

    path = bench.tdms((slice(0, 350), scale(2.0)), (slice(350, N), scale(3.0)))
    bench.refuse(path, "2 segments", time="")
    first, second = read_segments(path)
    np.testing.assert_allclose(first.channel("force_n"), 2.0 * FORCE_N[:350])
    np.testing.assert_allclose(second.channel("force_n"), 3.0 * FORCE_N[350:])


def test_a_tdms_scale_or_axis_that_is_not_known_is_refused(bench: Bench) -> None:
    unknown = {"wf_increment": 2e-4, "force:NI_Number_Of_Scales": 1, "force:NI_Scale[0]_Scale_Type": "Reciprocal"}
    path = bench.tdms((slice(0, N), unknown))
    bench.refuse(path, "force_n: Unsupported scale type: Reciprocal", time="")
    same(bench.load(path, more='overrule_units = ["force_n"]', time="")[0])
    bench.refuse(bench.tdms((slice(0, N), {"wf_increment": 2e-4, "wf_xunit_string": "Hz"})), "not over time", time="")
    milli = bench.tdms((slice(0, N), {"wf_increment": 0.2, "wf_xunit_string": "ms"}))
    assert bench.load(milli, time="")[0].sample_rate_hz == pytest.approx(RATE_HZ)


def test_a_tdms_file_that_was_not_finalised_is_an_incomplete_trial(bench: Bench) -> None:
    path = bench.tdms((slice(0, 400), {"wf_increment": 2e-4}), (slice(400, N), {"wf_increment": 2e-4}))
    data = bytearray(path.read_bytes())
    last = data.rindex(b"TDSm")
    data[last + 12 : last + 20] = b"\xff" * 8
    path.write_bytes(data)
    (trial,) = bench.load(path, time="")
    same(trial)
    assert trial.status == "incomplete" and "did not finalise" in trial.reason
    # the last block was half written: of each channel what all have
    path.write_bytes(data[:-1000])
    (trial,) = bench.load(path, time="")
    assert trial.status == "incomplete" and 400 <= trial.n_valid < N
    same(trial, slice(0, trial.n_valid))


@pytest.mark.parametrize(
    ("name", "stored", "attributes", "words"),
    [
        ("force_n", np.int16(FORCE_N / 2e-3), {"scale_factor": 2e-3, "add_offset": 0.0, "units": "N"}, ""),
        ("force_n", np.int16(FORCE_N / 2e-3 - 50), {"scale_factor": [2e-3], "add_offset": 0.1, "units": "N"}, ""),
        ("force_n", np.int16(FORCE_N * 1e3), {"conversion": 1e-3, "offset": 0.0, "unit": "newtons"}, ""),
        ("force_n", np.int16(FORCE_N * 1e3), {"scale_factor": "0.001"}, ""),
        ("key", np.int16(KEY / 4), {"scale_factor": np.float32(4.0), "units": np.array(["counts"], dtype="S")}, ""),
        ("force_n", FORCE_N, {"units": np.array(["N"], dtype=object)}, ""),
        ("force_n", FORCE_N, {"unit": "lbf"}, "force_n is in 'lbf' by the file itself"),
        ("force_n", FORCE_N, {"unit": "N", "Units": "kN"}, "units that the file states contradict each other"),
        ("force_n", FORCE_N, {"scale_factor": 2.0, "conversion": 3.0}, "contradict each other"),
        ("force_n", FORCE_N, {"gain": 2.0}, "property gain = 2.0 may be a scale"),
        ("force_n", FORCE_N, {"calibration_slope": [2.0, 3.0]}, "property calibration_slope = several numbers"),
        ("force_n", FORCE_N, {"_FillValue": FORCE_N[-1]}, "force_n row 351: found nan"),
        (
            "force_n",
            np.float32(FORCE_N),
            {"missing_value": np.array([-1.0, FORCE_N[250]])},
            "force_n row 251: found nan",
        ),
        ("force_n", np.uint16(FORCE_N * 8e3).view(np.int16), {"_Unsigned": "true", "scale_factor": 1.25e-4}, ""),
        ("force_n", FORCE_N, {"unit_string": "kN"}, "force_n is in 'kN' by the file itself"),
        ("force_n", FORCE_N, {"engineering_unit": "kN"}, "force_n is in 'kN' by the file itself"),
        ("force_n", FORCE_N, {"unit_serial": "DAQ 3", "x_unit": "ms"}, ""),
        ("force_n", FORCE_N, {"newtons_per_bit": "0.002 N"}, "property newtons_per_bit = 0.002 N may be a scale"),
        ("hammer", np.int32(HAMMER), {"resolution": 2e-3}, "property resolution = 0.002 may be a scale"),
        ("force_n", FORCE_N, {"resolution": 2e-3, "calibration_date": 20260103, "calibration": "2026-01-03"}, ""),
        ("time_s", TIME_S, {"units": "seconds since 2026-11-29"}, ""),
        ("force_n", FORCE_N, {"sampling_rate": 1e4}, "0.0001 s by the file itself, the mapping or a column of times"),
        ("force_n", FORCE_N, {"Sample Rate": "5000", "dt": 2e-4}, ""),
        ("force_n", FORCE_N, {"gain": 1.0, "offset_v": 0.0, "long_name": "force", "range": [0.0, 8.0]}, ""),
    ],
)
def test_scales_and_units_of_hdf5_are_applied_or_refused(bench: Bench, name, stored, attributes, words: str) -> None:
    path = bench.folder / "a.h5"
    with h5py.File(path, "w") as file:
        for channel, values in CHANNELS.items():
            file[channel] = stored if channel == name else values
        file[name].attrs.update({k: v for k, v in attributes.items() if not isinstance(v, np.ndarray)})
        for key, value in attributes.items():
            if isinstance(value, np.ndarray):
                kind = h5py.string_dtype() if value.dtype.kind == "O" else value.dtype
                file[name].attrs.create(key, value, dtype=kind)
    if words:
        bench.refuse(path, words)
    else:
        same(bench.load(path)[0])
    if "may be" in words or f"{name} is in" in words:
        same(bench.load(path, more=f'overrule_units = ["{name}"]')[0])


def test_hdf5_vectors_of_matlab_tables_and_nwb_series(bench: Bench) -> None:
    path = bench.folder / "a.h5"
    for shape in ((1, N), (N, 1)):
        with h5py.File(path, "w") as file:
            for name, values in CHANNELS.items():
                file[name] = values.reshape(shape)
            file["other"] = np.zeros((N, 2))
        same(bench.load(path)[0])
        bench.refuse(path, "other is a table of (600, 2) numbers", time='[time]\nchannel = "other"\n')
    table = np.rec.fromarrays(list(CHANNELS.values()), names=list(CHANNELS))
    with h5py.File(path, "w") as file:
        file["a row"] = table.dtype  # a type by name is no dataset
        file["run"] = table
        file["run"].attrs["units"] = ["s", "N", "counts", "counts"]
    assert read_segments(path)[0].units == UNITS
    same(bench.load(path)[0])
    with h5py.File(path, "w") as file:
        for name, values in list(CHANNELS.items())[1:]:
            file[f"acquisition/{name}/data"] = values
            file[f"acquisition/{name}/starting_time"] = 0.0
            file[f"acquisition/{name}/starting_time"].attrs["rate"] = float(RATE_HZ)
    (series,) = read_segments(path)
    assert series.interval([f"acquisition/{n}/data" for n in ("force_n", "key")], None) == 1 / RATE_HZ


def counted(bits: int, first: int, signed: bool) -> NDArray[np.float64]:
    """The key's counts as a counter of so many bits gives them, beginning with ``first``."""
    raw = (KEY + first) % 2**bits
    return np.where(raw >= 2 ** (bits - 1), raw - 2.0**bits, raw) if signed else raw


@pytest.mark.parametrize(
    ("bits", "first", "signed"),
    [(16, -32_000, True), (16, 40, False), (24, 40, False), (32, 40, False), (20, 9, False)],
)
def test_counter_wraps_are_unwrapped_when_stated_and_named_when_not(bench: Bench, bits, first, signed) -> None:
    path = bench.csv({**CHANNELS, "key": counted(bits, first, signed)})
    (trial,) = bench.load(path, key=f"counter_bits = {bits}")
    np.testing.assert_array_equal(trial.encoder_count[:, 0], KEY + first)
    if bits in (16, 24, 32):
        bench.refuse(path, f"the wrap of a counter of {bits} bits; say counter_bits = {bits}")
    wrong = bench.csv({**CHANNELS, "key": KEY + 2.0**bits})
    bench.refuse(wrong, f"more than a counter of counter_bits = {bits} holds", key=f"counter_bits = {bits}")
    # nothing wraps here, also where a bit sticks
    same(bench.load(bench.csv(), key=f"counter_bits = {max(bits, 20)}")[0])
    if bits == 16:
        stuck = np.where(np.arange(N) == 450, KEY + 65_536, KEY)
        assert bench.load(bench.csv({**CHANNELS, "key": stuck}))[0].encoder_count[450, 0] == KEY[450] + 65_536


def test_speed_and_force_beyond_the_limits_are_said_with_their_row(bench: Bench, capsys) -> None:
    from tests.command_line import run

    jump = np.where(np.arange(N) >= 400, KEY + 3000, KEY)
    force = np.where(np.arange(N) == 500, 150.0, FORCE_N)
    path = bench.csv({**CHANNELS, "key": jump, "force_n": force})
    (bench.folder / "m.toml").write_text(MAPPING.format(more="", time=TIME, key=""))
    assert run("import", path, "--mapping", bench.folder / "m.toml", "--out", bench.folder / "s") == 0
    said = capsys.readouterr().out
    assert "row 501: force 150 N, beyond limits.force_max_n = 110 N" in said
    assert "row 401: key 57.52 rad/s, beyond limits.speed_rad_per_s of 15 rad/s" in said
    notes = Session.open(bench.folder / "s").info.notes
    assert "row 501" in notes["limits of trial 1"]
    wide = "limits = {force_max_n = 200.0, speed_rad_per_s = [100.0, 100.0, 100.0]}"
    (bench.folder / "m.toml").write_text(MAPPING.format(more=wide, time=TIME, key=""))
    assert run("import", path, "--mapping", bench.folder / "m.toml", "--out", bench.folder / "s2") == 0
    assert "beyond the limits" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("above", "names", "more"),
    [
        ("Action 3, evening\nRate,5000\n\n", "", "names_row = 4"),
        ("Action 3, evening\nRate,5000\n", "", "skip_rows = 2"),
        ("", "# time_s,force_n,key,hammer", ""),
        ("# made by numpy\n", "# time_s,force_n,key,hammer\n# s,N,counts,counts", ""),
        ("# made by numpy\n", "#time_s,force_n,key,hammer", "names_row = 2"),
        ("sep=,\n", "", ""),
        ('"sep=,"\nAction\n', "", "names_row = 3"),
    ],
)
def test_csv_files_with_lines_above_their_numbers(bench: Bench, above: str, names: str, more: str) -> None:
    same(bench.load(bench.csv(above=above, names=names), more=more)[0])


def test_csv_files_that_are_not_as_the_mapping_says(bench: Bench) -> None:
    bench.refuse(bench.csv(above="sep=;\n"), "its first line says sep=;, the mapping separator = ','")
    bench.refuse(bench.csv(above="Action\n"), "names_row in the mapping tells the line of the names")
    bench.refuse(bench.csv(above="Action\n"), "rows of numbers, allowed from 1", more="names_row = 9000")
    with pytest.raises(RigInputError, match="names_row and skip_rows: allowed is one of them"):
        parse_mapping(MAPPING.format(more="names_row = 1\nskip_rows = 1", time=TIME, key=""))
    path = bench.csv()
    path.write_text(path.read_text().split("\n", 1)[1])
    bench.refuse(path, "its first row holds numbers, no names of columns")


@pytest.mark.parametrize("unit", ["m/s^2", "%", "Nm", "bar", "n/a", "rpm", ""])
def test_a_row_of_units_may_hold_one_that_is_not_known(bench: Bench, unit: str) -> None:
    columns = {**CHANNELS, "other": np.full(N, 0.5)}
    path = bench.csv(columns, names=f"{','.join(columns)}\ns,N,counts,counts,{unit}")
    same(bench.load(path)[0])
    assert read_segments(path)[0].units.get("other", "") == unit
    assert read_segments(path)[0].units["force_n"] == "N"


@pytest.mark.parametrize(("sign", "stated"), [("\u00a0", " "), ("\u202f", " "), ("\u2009", " "), ("\u2019", "'")])
def test_thousands_as_spreadsheets_of_other_countries_write_them(bench: Bench, sign: str, stated: str) -> None:
    path = bench.folder / "a.csv"
    rows = zip(*CHANNELS.values(), strict=True)
    text = "\n".join(";".join(f"{v:,.4f}".replace(",", sign).replace(".", ",") for v in row) for row in rows)
    path.write_text(";".join(CHANNELS) + "\n" + text + "\n", encoding="utf-8")
    european = 'separator = ";"\ndecimal = ","\n'
    same(bench.load(path, more=f'{european}thousands = "{stated}"')[0])
    bench.refuse(path, f'the mapping can say thousands = "{stated}"', more=european)


LVM = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t.
X_Columns\t{columns}
***End_of_Header***\t

Channels\t4
Samples\t{n}\t{n}\t{n}\t{spare}
Date\t2026/11/27\t2026/11/27\t2026/11/27\t2026/11/27
Time\t10:15:00.1\t10:15:00.1\t10:15:00.1\t10:15:00.1
Y_Unit_Label\tN\tcounts\tcounts\tV
X0\t0\t0\t0\t0
Delta_X\t{step}\t{step}\t{step}\t{step}
***End_of_Header***
X_Value\tforce_n\tkey\thammer\tspare\tComment
"""


def lvm(bench: Bench, step: str, digits: int | None, spare: int = 0, rate_hz: float = RATE_HZ) -> Path:
    """A blow in LVM; the times with so many digits, or not written."""
    text = LVM.format(columns="No" if digits is None else "One", n=N, spare=spare, step=step)
    for k in range(N):
        time = "" if digits is None else f"{k / rate_hz:.{digits}f}"
        cells = [time, f"{FORCE_N[k]:.6f}", f"{KEY[k]:.0f}", f"{HAMMER[k]:.0f}", "0.5" if k < spare else ""]
        text += "\t".join(cells).rstrip("\t") + "\n"
    path = bench.folder / "a.lvm"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("spare", [0, 1, 250, N])
def test_lvm_channels_may_have_fewer_samples_or_none(bench: Bench, spare: int) -> None:
    path = lvm(bench, "0.000200", 6, spare)
    same(bench.load(path, time="")[0])
    (table,) = read_segments(path)
    assert "spare" in table.unreadable if spare == 0 else table.channel("spare").size == spare
    path.write_text(path.read_text().replace(f"\t{N}\t{spare}\n", f"\t{N}\t{spare + 3}\n"))
    bench.refuse(path, "row" if spare < N else "Samples says 603", time="")


def test_lvm_delta_x_of_six_digits_is_a_rate_only_with_the_mapping_or_the_times(bench: Bench) -> None:
    stated, start = "[time]\nsample_rate_hz = 48000.0\n", "blow_start_s = 0.004"
    (trial,) = bench.load(lvm(bench, "0.000021", None), time=stated, more=start)
    same(trial)
    assert trial.sample_rate_hz == 48000.0
    bench.refuse(lvm(bench, "0.000021", None), "its rate is known to 2.4 % only", time="", more=start)
    bench.refuse(lvm(bench, "0.000021", None), "by the file itself", time=stated.replace("48", "50"), more=start)
    (trial,) = bench.load(lvm(bench, "0.000021", 6, rate_hz=48_000), time="", more=start)
    assert trial.sample_rate_hz == pytest.approx(48_000, rel=1e-4)
    (trial,) = bench.load(lvm(bench, "0.0002", None), time="")
    assert trial.sample_rate_hz == RATE_HZ
    (trial,) = bench.load(lvm(bench, "2.08333E-5", None), time="", more=start)
    assert trial.sample_rate_hz == pytest.approx(48_000, rel=1e-5)


@pytest.mark.parametrize("digits", [3, 2])
def test_lvm_times_of_few_digits_are_confirmed_by_delta_x(bench: Bench, digits: int) -> None:
    for time in (STATED, ""):
        same(bench.load(lvm(bench, "0.000200", digits), time=time)[0])
    bench.refuse(lvm(bench, "0.000200", digits, rate_hz=2500), "is not where Delta_X 0.0002 puts it", time="")


def test_a_force_is_read_as_a_table_or_by_a_mapping(bench: Bench) -> None:
    for path in (bench.csv(), lvm(bench, "0.000200", 6)):
        time_s, force_n = read_force(path)
        np.testing.assert_allclose(time_s, TIME_S, atol=1e-12)
        np.testing.assert_allclose(force_n, FORCE_N, atol=1e-12)
    kilo = bench.csv(names="time_s,force_n,key,hammer\ns,mN,counts,counts")
    np.testing.assert_allclose(read_force(kilo)[1], 1e-3 * FORCE_N)
    with pytest.raises(RigInputError, match="force_n is in 'bar', allowed N"):
        read_force(bench.csv(names="time_s,force_n,key,hammer\ns,bar,counts,counts"))
    trial = read_recording(bench.csv(), parse_mapping(MAPPING.format(more="", time=TIME, key="")))
    same(trial)


def test_numbers_beside_a_channel_that_may_be_its_scale_are_asked_for(bench: Bench) -> None:
    path, codes = bench.folder / "a.h5", np.int16(FORCE_N / 2e-3)
    for stored, beside, words in (
        (codes, {"scale_factor": 2e-3}, "property scale_factor = 0.002 may be a scale"),
        (FORCE_N, {"force_n_gain": 3.0}, "property force_n_gain = 3.0 may be a scale"),
        (FORCE_N, {"amplifier_gain": 3.0}, ""),
    ):
        for are_attributes in (True, False):
            with h5py.File(path, "w") as file:
                for name, values in {**CHANNELS, "force_n": stored}.items():
                    file[name] = values
                for key, value in beside.items():
                    if are_attributes:
                        file.attrs[key] = value
                    else:
                        file[key] = value
            if words:
                bench.refuse(path, words)
            else:
                same(bench.load(path)[0])


def test_a_rate_beside_the_channels_is_their_clock_and_may_be_ignored(bench: Bench) -> None:
    path = bench.folder / "a.h5"
    untimed = {name: values for name, values in CHANNELS.items() if name != "time_s"}
    for rate_hz, time in ((5000.0, ""), (4000.0, STATED + 'ignore = ["SampleRate"]\n')):
        with h5py.File(path, "w") as file:
            for name, values in untimed.items():
                file[name] = values
            file.attrs["SampleRate"] = rate_hz
        (trial,) = bench.load(path, time=time)
        same(trial)
        assert trial.sample_rate_hz == pytest.approx(RATE_HZ)
    bench.refuse(path, 'time.ignore = ["SampleRate"] in the mapping where the file is wrong', time=STATED)


def test_a_virtual_dataset_without_its_file_is_not_read_as_zeros(bench: Bench) -> None:
    path = bench.folder / "a.h5"
    with h5py.File(path, "w", libver="latest") as file:
        for name in ("time_s", "key", "hammer"):
            file[name] = CHANNELS[name]
        layout = h5py.VirtualLayout(shape=(N,), dtype="f8")
        layout[:] = h5py.VirtualSource("force.h5", "force_n", shape=(N,))
        file.create_virtual_dataset("force_n", layout)
    bench.refuse(path, "force_n lies in the file force.h5, which is not there", more="blow_start_s = 0.04")
    with h5py.File(bench.folder / "force.h5", "w") as file:
        file["force_n"] = FORCE_N
    same(bench.load(path)[0])


@pytest.mark.parametrize(
    ("name", "form"),
    [
        *itertools.product(("Force (kN)", "F / kN", "Kraft in kN", "force_kN", "F/kN", "load [kN]"), ("csv", "tdms")),
        *itertools.product(("Force (kN)", "Kraft in kN", "force_kN"), ("h5",)),
    ],
)
def test_a_unit_in_the_name_of_a_channel_is_one_that_the_file_states(bench: Bench, name: str, form: str) -> None:
    path = bench.folder / f"a.{form}"
    channels = {name if key == "force_n" else key: values for key, values in CHANNELS.items()}
    if form == "csv":
        bench.csv(channels)
    elif form == "h5":
        with h5py.File(path, "w") as file:
            for key, values in channels.items():
                file[key] = values
    else:
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment([nptdms.ChannelObject("g", key, values) for key, values in channels.items()])
    mapping = MAPPING.format(more="", time=TIME, key="").replace('"force_n"', f'"{name}"')
    with pytest.raises(RigInputError, match="is in 'kN' by the file itself, the mapping says 'N'"):
        read_recording(path, parse_mapping(mapping))
    trial = read_recording(path, parse_mapping(mapping.replace(f'"{name}"', f'"{name}"\nunit = "kN"')))
    np.testing.assert_allclose(trial.raw_force_n, 1e3 * FORCE_N)


def test_words_in_the_name_of_a_channel_are_no_units(bench: Bench) -> None:
    for name in ("load_second", "sensor_a", "Force (old)", "load_g", "in/out", "force_n", "Date/Time"):
        channels = {name if key == "force_n" else key: values for key, values in CHANNELS.items()}
        bench.csv(channels)
        mapping = MAPPING.format(more="", time=TIME, key="").replace('"force_n"', f'"{name}"')
        same(read_recording(bench.folder / "a.csv", parse_mapping(mapping)))


AT = np.datetime64("2026-11-29T10:58:59.96") + np.round(TIME_S * 1e6).astype("m8[us]")


@pytest.mark.parametrize(
    "write",
    [
        lambda t: str(t),
        lambda t: f"{t}Z",
        lambda t: t.item().strftime("%d.%m.%Y %H:%M:%S,%f"),
        lambda t: t.item().strftime("%m/%d/%Y, %I:%M:%S.%f %p"),
        lambda t: t.item().strftime("%H:%M:%S:%f"),
        lambda t: t.item().strftime("%M:%S.%f"),
    ],
)
def test_clock_times_of_any_form_are_compared_with_a_stated_rate(bench: Bench, write) -> None:
    def table(rows) -> Path:
        path = bench.folder / "a.csv"
        lines = [f'"{write(AT[k])}",{FORCE_N[k]:.10g},{KEY[k]:.0f},{HAMMER[k]:.0f}' for k in rows]
        path.write_text("time_s,force_n,key,hammer\n" + "\n".join(lines) + "\n")
        return path

    whole, gap = np.arange(N), np.r_[0:100, 170:N]
    same(bench.load(table(whole))[0])
    same(bench.load(table(whole), time=STATED)[0])
    table(gap)
    bench.refuse(
        bench.folder / "a.csv", "time_s row 101: 0.034 s comes after 0.0198 s, samples are missing: 70", time=STATED
    )


@pytest.mark.parametrize(
    ("name", "step"),
    [
        *itertools.product(("Time Stamp", "Time  1 - default sample rate", "seconds", "Sample"), (1.0, 2e-4)),
        ("Zeit / s", 2e-4),
        ("t/s", 2e-4),
    ],
)
def test_a_column_that_numbers_the_samples_is_compared_with_a_stated_rate(bench: Bench, name: str, step: float) -> None:
    numbers = {**CHANNELS, "time_s": np.arange(N) * step}
    names = f"{name},force_n,key,hammer"
    same(bench.load(bench.csv(numbers, names=names), time=STATED)[0])
    path = bench.csv({key: values[GAP] for key, values in numbers.items()}, names=names)
    bench.refuse(path, f"{name} row 201: 0.052 s comes after 0.0398 s, samples are missing: 60", time=STATED)
    whole = bench.load(path, time=STATED + f'ignore = ["{name}"]\n')[0]
    same(whole, GAP)


def test_cells_that_spreadsheets_leave_empty_are_no_samples(bench: Bench) -> None:
    path = bench.csv()
    written = path.read_text()
    path.write_text(written + ",,,\n , ,,\n\n")
    same(bench.load(path)[0])
    names, _, body = written.partition("\n")
    path.write_text(names + "\n" + body.replace("\n", ",\n"))
    same(bench.load(path)[0])
    path.write_text(names + "\n,,,\n" + body)
    bench.refuse(path, "force_n row 1: found ''")


def test_quoted_cells_may_hold_the_separator(bench: Bench) -> None:
    path = bench.folder / "a.csv"
    rows = zip(*CHANNELS.values(), strict=True)
    lines = [",".join(f'"{value:.10g}"'.replace(".", ",") for value in row) for row in rows]
    path.write_text("time_s,force_n,key,hammer\n" + "\n".join(lines) + "\n")
    same(bench.load(path, more='decimal = ","')[0])
    bench.refuse(path, 'the mapping can say decimal = ","')
    path.write_text(path.read_text().replace('"', ""))
    bench.refuse(path, "cells, allowed 4", more='decimal = ","')


def test_matlab_files_of_both_kinds_are_read(bench: Bench) -> None:
    from scipy.io import savemat

    path = bench.folder / "a.mat"
    savemat(path, {name: values[:, None] for name, values in CHANNELS.items()})
    same(bench.load(path)[0])
    savemat(
        path, {"run": {name: CHANNELS[name] for name in CHANNELS if name != "time_s"}, "Fs": 5000.0, "units": UNITS}
    )
    mapping = MAPPING.format(more="", time="", key="")
    for name in ("force_n", "key", "hammer"):
        mapping = mapping.replace(f'channel = "{name}"', f'channel = "run/{name}"')
    same(read_recording(path, parse_mapping(mapping)))
    savemat(path, {**CHANNELS, "force_n": np.int16(FORCE_N / 2e-3), "force_n_scale": 2e-3})
    bench.refuse(path, "property force_n_scale = 0.002 may be a scale")
    path.write_bytes(path.read_bytes()[:300])
    bench.refuse(path, "not a readable MATLAB file")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in CHANNELS.items():
            file[name] = values[None, :]
    same(bench.load(path)[0])


def test_a_motor_command_in_another_unit_needs_its_scale(bench: Bench) -> None:
    path = bench.csv({**CHANNELS, "Motor (mV)": 500.0 * PUSH})
    motor = '[motor]\nchannel = "Motor (mV)"\n'
    with pytest.raises(RigInputError, match=r"Motor \(mV\) is in 'mV' by the file itself, the mapping says 'V'"):
        read_recording(path, parse_mapping(MAPPING.format(more="", time=TIME, key="") + motor))
    scaled = MAPPING.format(more="", time=TIME, key="") + motor + "volts_per_unit = 1e-3\n"
    np.testing.assert_allclose(read_recording(path, parse_mapping(scaled)).motor_command_v, 0.5 * PUSH)
