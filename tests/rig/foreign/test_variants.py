"""Variants of one format that programs write: each must give the numbers that went in, or be refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.errors import InputError
from rig.foreign import read_channels
from rig.foreign.channel_table import Clock
from rig.foreign.csv_text import parse_csv
from rig.foreign.lvm_text import parse_lvm
from rig.foreign.reading import joined
from tests.rig.foreign import tdms_bytes

FORCE = np.array([0.0, 0.25, -1.5, 3e-3, 12.5])
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
        joined((first, second), ["Force"])


def test_one_heading_stands_for_all_packets_that_follow() -> None:
    more = segment(2e-4, 1e-3, 2).partition("Comment\r\n")[2]
    text = file_of(segment(2e-4, 0.0, 1) + more, headings="No")
    both = parse_lvm(text, "a.lvm")
    whole = joined(both, ["Force", "Key"])
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
        assert joined(parts, ["Key"]).channel("Key").size == 10
    else:
        with pytest.raises(InputError, match=words):
            joined(parts, ["Key"])


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


def test_a_rate_of_the_mapping_must_be_the_files_as_far_as_its_digits_go() -> None:
    text, binary = Clock(0.000333, resolution_s=1e-6), Clock(2e-4)
    assert text.agrees(1 / 3000) and not text.agrees(1 / 2990) and binary.agrees(1 / 5000)
    assert not binary.agrees(1 / 4000) and not binary.agrees(1 / 4990)


def test_delta_x_with_few_digits_yields_to_the_times() -> None:
    text = file_of(segment(1 / 48_000, 0.0, 1)).replace(str(1 / 48_000), "0.000021")
    (table,) = parse_lvm(text, "a.lvm")
    assert table.interval(["Key"], None) == pytest.approx(1 / 48_000, rel=0.01)
    with pytest.raises(InputError, match="Delta_X says 2.4e-05"):
        parse_lvm(text.replace("0.000021\t0.000021", "0.000024\t0.000024"), "a.lvm")


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


@pytest.mark.parametrize("head", ["t;Force;Key\ns;kgf;ticks\n", "t [s];Force (kgf);Key [Counts];\n"])
def test_csv_states_its_units(head: str) -> None:
    tail = ";" if head.endswith(";\n") else ""
    rows = "".join(f"{0.0002 * k:.4f};{FORCE[k]};{KEY[k]:.0f}{tail}\r\n".replace(".", ",") for k in range(5))
    table = parse_csv(f"\ufeff# bench 2\n{head}{rows}", "a.csv", ";", ",")
    time, force, key = list(table.channels)
    np.testing.assert_array_equal(table.channel(force), FORCE)
    assert [table.units[name].lower() in ("s", "kgf", "ticks", "counts") for name in (time, force, key)] == [True] * 3
    assert table.interval([force, key], time) == pytest.approx(2e-4)


@pytest.mark.parametrize("style", ["10:59:59.{:04d}", "2026-11-21T10:59:59.{:04d}", "2026-11-21 10:59:59.{:04d}"])
def test_csv_with_clock_times(style: str) -> None:
    rows = "".join(f"{style.format(2 * k)},{FORCE[k]}\n" for k in range(5))
    table = parse_csv(f"when,f\n{rows}", "a.csv")
    np.testing.assert_allclose(table.channel("when"), 2e-4 * np.arange(5), atol=1e-9)
    assert table.units == {"when": "s"}
    with pytest.raises(InputError, match="when row 6: found 'noon', allowed a time like the first"):
        parse_csv(f"when,f\n{rows}noon,2\n", "a.csv").channel("when")
