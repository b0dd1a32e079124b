"""Channels of other programs' files: what was written comes back; what is damaged is refused in one line.

Variants of one format that programs write: each must give the numbers that went in, or be refused in one line.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from rig import ChannelTable, InputError, read_channels
from rig.foreign.csv_file import parse_csv
from rig.foreign.lvm_file import parse_lvm
from rig.foreign.reading import join_segments
from tests.rig.foreign import tdms_bytes

TIME = np.arange(5) * 2e-4
FORCE = np.array([0.0, 0.25, -1.5, 3e-3, 12.5])
ANGLE = np.array([7.0, 8.0, 9.5, 11.0, -3.0])


LVM = """LabVIEW Measurement
Writer_Version\t2
Separator\t{name}
Decimal_Separator\t{decimal}
X_Columns\t{columns}
***End_of_Header***

Channels\t2
Samples\t{samples}{gap}\t{samples}
Y_Unit_Label\tNewtons{gap}\tdeg
X0\t0{gap}\t0
Delta_X\t{step}{gap}\t{step}
***End_of_Header***
X_Value\tForce{second}\tKey\tComment
"""


def lvm(columns: str = "One", separator: str = "\t", decimal: str = ".", samples: str = "5", rows: int = 5) -> str:
    """A segment; with a time for each channel, what its header says of the second stands over the second time."""
    name = {"\t": "Tab", ",": "Comma"}[separator]
    gap, second = ("\t", "\tX_Value") if columns == "Multi" else ("", "")
    text = LVM.format(
        name=name, decimal=decimal, columns=columns, samples=samples, gap=gap, second=second,
        step="0.0002".replace(".", decimal),
    )  # fmt: skip
    for t, f, a in list(zip(TIME, FORCE, ANGLE, strict=True))[:rows]:
        cells = {"One": [t, f, a], "No": ["", f, a], "Multi": [t, f, t, a]}[columns]
        text += "\t".join(c if c == "" else f"{c:.6f}".replace(".", decimal) for c in cells) + "\n"
    return text.replace("\t", separator).replace("\n", "\r\n")


@pytest.mark.parametrize("columns", ["One", "No", "Multi"])
@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), ("\t", ","), (",", ".")])
def test_lvm_gives_each_channel_its_numbers(columns: str, separator: str, decimal: str) -> None:
    (table,) = parse_lvm(lvm(columns, separator, decimal), "a.lvm")
    np.testing.assert_allclose(table.channel("Force"), FORCE, atol=1e-9)
    np.testing.assert_allclose(table.channel("Key"), ANGLE, atol=1e-9)
    np.testing.assert_allclose(table.channel("X_Value"), TIME, atol=1e-9)
    assert table.interval(["Force", "Key"], None) == 2e-4
    assert table.units == {"Force": "Newtons", "Key": "deg", "X_Value": "s"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello", "first line"),
        (lvm(rows=4), "4 rows, but Samples says 5"),
        (lvm(samples="five"), "Samples ['five', 'five']"),
        (lvm().replace("12.500000", "12,500000"), "allowed a number"),
        (lvm().replace("\t12.500000\t", "\t"), "cells, allowed 3"),
        (lvm().replace("0.000400\t", "0.000400\t7\t"), "comment '9.500000' is a number"),
        (lvm()[: lvm().rindex("***End_of_Header***")], "0 segments"),
        (lvm().replace("***End_of_Header***", "***Start_Special***", 1), "without"),
        (lvm().replace("X0\t0", "X_Dimension\tFrequency\r\nX0\t0"), "X_Dimension ['Frequency']"),
        (lvm().replace("X_Columns\tOne", "X_Columns\tTwo"), "X_Columns 'Two'"),
        (lvm().replace("Separator\tTab", "Separator\tPipe", 1), "Separator 'Pipe'"),
        (lvm("Multi").replace("0.000400\t9.5", "0.000500\t9.5"), "intervals off"),
        (lvm().replace("Delta_X\t0.0002\t0.0002", "Delta_X\t0.0002\t0.0004"), "Delta_X says 0.0004"),
    ],
)
def test_a_damaged_lvm_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=r"^a\.lvm: ") as caught:
        parse_lvm(text, "a.lvm")
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "0 rows"),
        ("a,b\n", "0 rows"),
        ("a,b,b\n1,2,3\n", "2 columns are named 'b'"),
        ("a,b\nwhy,what\n1,2\n", "found 'what'"),
        ("1,2\n3,4\n", "its first row holds numbers, no names"),
        ("a,b\ns,nan\n1,2\n", "found 'nan'"),
        ("a,b\n1,10:00\n2,3\n", "row 2: found '3', allowed a time like"),
        ("a,b\n1\n", "row 1: 1 cells, allowed 2"),
        ("a,b\n1,2\n1,x\n", "b row 2: found 'x'"),
        ("a,b\n1,nan\n", "found 'nan'"),
        ("a,b\n1,1_000\n", "1_000"),
        ("a,b\n1,1e999\n", "1e999"),
        ("a,b\n1,0x1f\n", "0x1f"),
        ('a,b\n1,"2\n', "not a CSV file"),
        ("a,b\n1,\0\n", "null"),
    ],
)
def test_a_damaged_csv_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=r"^a\.csv: ") as caught:
        parse_csv(text, "a.csv").channel("b")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_plain_hdf5_and_a_name_that_is_not_there(tmp_path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["t"], file["f"], file["note"] = TIME, FORCE, "words"
    table = read_channels(path)
    np.testing.assert_array_equal(table.channel("f"), FORCE)
    with pytest.raises(InputError, match="no channel 'force'; there are f, t"):
        table.channel("force")
    with h5py.File(path, "a") as file:
        file["slow/g"] = FORCE[:2]
    with pytest.raises(InputError, match="f has 5 samples, slow/g 2"):
        read_channels(path).check_together(["f", "slow/g"])
    path.write_bytes(b"not hdf5")
    with pytest.raises(InputError, match="not a readable HDF5"):
        read_channels(path)


def interval_of(time: np.ndarray) -> float:
    return ChannelTable("a", {"t": time, "f": np.zeros(time.size)}).interval(["f"], "t")


@pytest.mark.parametrize("origin_s", [0.0, -3.0, 1.7e9, 3.8e9])
@pytest.mark.parametrize(("rate_hz", "digits"), [(1000, 3), (5000, 4), (3000, 4), (48_000, 6), (5000, 7), (2048, 9)])
def test_even_times_are_read_and_one_lost_sample_is_seen(origin_s: float, rate_hz: float, digits: int) -> None:
    time = np.round(origin_s + np.arange(2000) / rate_hz, digits)
    assert interval_of(time) == pytest.approx(1 / rate_hz, rel=1e-3)
    for lost in (1, 17, 999, 1000, 1997):
        with pytest.raises(InputError, match="samples are missing"):
            interval_of(np.delete(time, lost))


@pytest.mark.parametrize(("unit", "step"), [("s", 2e-4), ("ms", 0.2), ("us", 200.0)])
def test_times_are_in_the_unit_that_is_named(unit: str, step: float) -> None:
    table = ChannelTable("a", {"t": step * np.arange(40), "f": np.zeros(40)})
    assert table.interval(["f"], "t", unit=unit) == pytest.approx(2e-4)  # 5 kHz


def test_times_must_be_even() -> None:
    time = np.arange(40) / 5000
    for wrong, words in (
        (time[::-1], "does not rise"),
        (np.concatenate((time[:20], time[18:])), "row 21: .* comes after"),
        (np.floor(time * 1000) / 1000, "too coarse"),
        (time**1.01, "off even spacing"),
    ):
        with pytest.raises(InputError, match=words):
            interval_of(wrong)
    with pytest.raises(InputError, match="row 3: found nan"):
        interval_of(np.array([0, 1, np.nan]))
    with pytest.raises(InputError, match="no times"):
        ChannelTable("a", {"f": time}).interval(["f"], None)


KEY = np.array([7.0, 8.0, 9.0, 11.0, -3.0])
SPECIAL = "***Start_Special***\r\nanything\tat all\r\n***End_Special***\r\n"


def segment(step: float, start: float, scale: float, stamp: str = "", x: str = "One", notes: str = "") -> str:
    """A header and five rows; the channels hold ``scale`` times FORCE and KEY."""
    rows = [("Channels", "2"), ("Samples", "5", "5"), ("X_Dimension", "Time", "Time"), ("X0", f"{start}", f"{start}")]
    rows += [("Delta_X", f"{step}", f"{step}"), *([("Date", "2026/11/21"), ("Time", stamp)] if stamp else [])]
    text = notes + "".join("\t".join((*row, row[-1]) if len(row) == 2 and stamp and row[0] in ("Date", "Time") else row)
                           + "\r\n" for row in rows)  # fmt: skip
    text += "***End_of_Header***\t\t\r\nX_Value\tForce\tKey\tComment\r\n"
    for k in range(5):
        time = "" if x == "No" else f"{start + k * step:.6f}"
        comment = "\tbegun" if k == 0 else ""
        text += f"{time}\t{scale * FORCE[k]:.6f}\t{scale * KEY[k]:.6f}{comment}\r\n"
    return text


def file_of(*segments: str, x: str = "One", headings: str = "Yes") -> str:
    head = "LabVIEW Measurement\t\r\nWriter_Version\t2\r\nSeparator\tTab\r\n"
    head += f"Multi_Headings\t{headings}\r\nX_Columns\t{x}\r\n"
    return head + "***End_of_Header***\t\r\n\t\r\n" + "\r\n".join(segments)


@pytest.mark.parametrize("x", ["One", "No"])
def test_every_lvm_segment_has_its_own_header_and_rate(x: str) -> None:
    notes = "Notes\tby hand\r\nTest_Name\tforte\r\n"
    text = file_of(segment(2e-4, 0.0, 1, x=x), segment(5e-4, 3.0, 2, x=x, notes=notes), SPECIAL, x=x)
    first, second = parse_lvm(text, "a.lvm")
    np.testing.assert_allclose(first.channel("Force"), FORCE, atol=1e-9)
    np.testing.assert_allclose(second.channel("Key"), 2 * KEY, atol=1e-9)
    assert first.interval(["Force", "Key"], None) == 2e-4 and second.interval(["Force", "Key"], None) == 5e-4
    np.testing.assert_allclose(second.channel("X_Value"), 3 + 5e-4 * np.arange(5), atol=1e-9)
    assert [table.where for table in (first, second)] == ["a.lvm segment 1", "a.lvm segment 2"]
    with pytest.raises(InputError, match="every 0.0005 s, in the segment before it every 0.0002 s"):
        join_segments((first, second), ["Force"])


def test_one_heading_stands_for_all_packets_that_follow() -> None:
    more = segment(2e-4, 1e-3, 2).partition("Comment\r\n")[2]
    text = file_of(segment(2e-4, 0.0, 1) + more, headings="No")
    both = parse_lvm(text, "a.lvm")
    whole = join_segments(both, ["Force", "Key"])
    np.testing.assert_allclose(whole.channel("Force"), np.concatenate((FORCE, 2 * FORCE)), atol=1e-9)
    assert whole.interval(["Force", "Key"], None) == 2e-4 and whole.where == "a.lvm"
    with pytest.raises(InputError, match="10 rows, but Samples says 5"):
        parse_lvm(text.replace("Multi_Headings\tNo", "Multi_Headings\tYes"), "a.lvm")


@pytest.mark.parametrize(
    ("starts", "stamps", "words"),
    [
        ((0.0, 1e-3), ("", ""), None),  # the times go on
        ((0.0, 0.0), ("10:00:00", "10:00:00.001"), None),  # the stamps do
        ((0.0, 0.0), ("09:59:59,9990000", "10:00:00"), None),  # in another country
        ((0.0, 0.0), ("", ""), None),  # nothing tells: the mapping's word
        ((0.0, 1.2e-3), ("", ""), "begins 0.0002 s after the end"),
        ((0.0, 0.0), ("10:00:00", "10:00:01"), "begins 0.999 s after the end"),
        ((1.0, 0.5), ("", ""), "begins -0.501 s after the end"),
    ],
)
def test_segments_are_joined_only_without_a_gap(starts, stamps, words) -> None:
    parts = parse_lvm(file_of(*(segment(2e-4, t, 1, s) for t, s in zip(starts, stamps, strict=True))), "a.lvm")
    if words is None:
        assert join_segments(parts, ["Key"]).channel("Key").size == 10
    else:
        with pytest.raises(InputError, match=words):
            join_segments(parts, ["Key"])


def test_each_lvm_channel_may_have_times_of_its_own() -> None:
    text = file_of(segment(2e-4, 0.0, 1), x="Multi").replace("X_Value\tForce\tKey", "X_Value\tForce\tX_Value\tKey")
    text = (
        text.replace("\t5\t5", "\t5\t\t5")
        .replace("0.0002\t0.0002", "0.0002\t\t0.0004")
        .replace("\t0.0\t0.0", "\t0.0\t\t0.0")
    )
    for k in range(5):
        row = f"{k * 2e-4:.6f}\t{FORCE[k]:.6f}\t"
        text = text.replace(row, f"{row}{k * 4e-4:.6f}\t")
    (table,) = parse_lvm(text, "a.lvm")
    assert "X_Value" not in table.channels and table.interval(["Key"], None) == 4e-4
    with pytest.raises(InputError, match="Force has a sample every 0.0002 s, Key every 0.0004 s"):
        table.interval(["Force", "Key"], None)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("interleaved", [False, True])
def test_tdms_of_either_byte_order_and_layout(tmp_path: Path, big: bool, interleaved: bool) -> None:
    pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    data = tdms_bytes.doubles(
        {"Force": FORCE, "Key": KEY}, {"wf_increment": 2e-4, "unit_string": "N"}, big=big, interleaved=interleaved
    )
    path.write_bytes(data + data)
    table = read_channels(path)
    np.testing.assert_array_equal(table.channel("Force"), np.tile(FORCE, 2))
    np.testing.assert_array_equal(table.channel("Key"), np.tile(KEY, 2))
    assert table.interval(["Force", "Key"], None) == 2e-4 and table.units["Key"] == "N"
    path.write_bytes((data + data)[:-5])
    with pytest.raises(InputError, match="cut off"):
        read_channels(path)


def test_daqmx_raw_data_are_scaled(tmp_path: Path) -> None:
    pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    raw = np.array([0, 100, -32768, 32767, 7], dtype=np.int16)
    path.write_bytes(
        tdms_bytes.daqmx({"Force": (raw, 0.5, 3.0), "Key": (raw[::-1], -2.0, 0.0)}, {"wf_increment": 2e-4})
    )
    table = read_channels(path)
    np.testing.assert_allclose(table.channel("Force"), 0.5 * raw + 3.0)
    np.testing.assert_allclose(table.channel("Key"), -2.0 * raw[::-1])


def test_tdms_channels_keep_their_own_clocks(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    when = np.datetime64("2026-11-21T10:00:00")
    clock = {"wf_increment": 2e-4, "wf_start_time": when}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", "Force", FORCE, clock),
            nptdms.ChannelObject("g", "Key", KEY, {**clock, "wf_start_offset": 1e-3}),
            nptdms.ChannelObject("g", "Room", FORCE[:2], {"wf_increment": 1.0}),
            nptdms.ChannelObject("g", "When", when + np.arange(5) * np.timedelta64(200, "us")),
        ])  # fmt: skip
    table = read_channels(path)
    assert table.interval(["Force"], "When") == pytest.approx(2e-4) and table.units["When"] == "s"
    with pytest.raises(InputError, match="Key begins 0.001 s after Force"):
        table.interval(["Force", "Key"], None)
    assert table.interval(["Force", "Key"], None, same_start=True) == 2e-4
    with pytest.raises(InputError, match="Force has 5 samples, Room 2"):
        table.interval(["Force", "Room"], None)
