"""Channels of other programs' files: what was written comes back; what is damaged is refused in one line."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from rig.errors import InputError
from rig.foreign import read_channels
from rig.foreign.channel_table import ChannelTable, number
from rig.foreign.csv_text import parse_csv
from rig.foreign.lvm_text import parse_lvm

TIME = np.arange(5) * 2e-4
FORCE = np.array([0.0, 0.25, -1.5, 3e-3, 12.5])
ANGLE = np.array([7.0, 8.0, 9.5, 11.0, -3.0])


def lvm(columns: str = "One", separator: str = "\t", decimal: str = ".", samples: str = "5", rows: int = 5) -> str:
    name = {"\t": "Tab", ",": "Comma"}[separator]

    def field(tag: str, *cells: str) -> str:
        """A field of the segment: each cell in the column of its channel."""
        gap = [""] if columns == "Multi" else []
        return separator.join((tag, cells[0], *gap, *cells[1:]))

    head = [
        "LabVIEW Measurement",
        *(
            separator.join(pair)
            for pair in (("Writer_Version", "2"), ("Separator", name), ("Decimal_Separator", decimal))
        ),
        separator.join(("X_Columns", columns)),
        "***End_of_Header***",
        "",
        separator.join(("Channels", "2")),
        field("Samples", samples, samples),
        field("Y_Unit_Label", "Newtons", "deg"),
        field("X0", "0", "0"),
        field("Delta_X", "0.0002".replace(".", decimal), "0.0002".replace(".", decimal)),
        "***End_of_Header***",
    ]
    names = {"One": ["X_Value", "Force", "Key"], "No": ["X_Value", "Force", "Key"]}.get(
        columns, ["X_Value", "Force", "X_Value", "Key"]
    )
    body = []
    for t, f, a in list(zip(TIME, FORCE, ANGLE, strict=True))[:rows]:
        cells = {"One": [t, f, a], "No": ["", f, a], "Multi": [t, f, t, a]}[columns]
        body.append(separator.join(c if c == "" else f"{c:.6f}".replace(".", decimal) for c in cells))
    return "\r\n".join([*head, separator.join([*names, "Comment"]), *body]) + "\r\n"


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


def test_csv_with_its_separator_and_decimal_sign() -> None:
    table = parse_csv("# bench 2\n t ; force\n0,0;1,5\n\n0,5;-2e-3\n", "a.csv", ";", ",")
    np.testing.assert_array_equal(table.channel("t"), [0, 0.5])
    np.testing.assert_array_equal(table.channel("force"), [1.5, -2e-3])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "0 rows"),
        ("a,b\n", "0 rows"),
        ("a,b,b\n1,2,3\n", "2 columns are named 'b'"),
        ("a,b\ns,what\n1,2\n", "found 'what'"),
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


def test_a_decimal_comma_is_not_read_as_a_point() -> None:
    assert number("1,5", ",") == 1.5
    with pytest.raises(ValueError, match=r"1\.5"):
        number("1.5", ",")


def test_tdms_gives_channels_units_and_rate(tmp_path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    force = nptdms.ChannelObject("daq", "Force", FORCE, {"wf_increment": 2e-4, "unit_string": "N"})
    key = nptdms.ChannelObject("daq", "Key", ANGLE.astype(np.int32), {"wf_increment": 2e-4})
    label = nptdms.ChannelObject("notes", "text", np.array(["x", "y"]))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([force, key, label])
        writer.write_segment([force, key])
    table = read_channels(path)
    np.testing.assert_array_equal(table.channel("Force"), np.tile(FORCE, 2))
    np.testing.assert_array_equal(table.channel("Key"), np.tile(ANGLE.astype(np.int32), 2))
    assert table.units == {"Force": "N"} and table.interval(["Force", "Key"], None) == 2e-4
    whole = path.read_bytes()
    for cut in (len(whole) - 3, len(whole) - 60, 30, 3):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"a\.tdms: "):
            read_channels(path)


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


def test_an_unknown_ending_is_refused() -> None:
    with pytest.raises(InputError, match=r"allowed \.csv"):
        read_channels("force.xlsx")
