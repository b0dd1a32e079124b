"""Imports from other countries: encodings, thousands dots, and when a recording began by its own statement."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from rig import InputError, RigInputError, Session, import_session
from rig.foreign.csv_file import decode_text, parse_csv
from rig.foreign.mapping import parse_mapping
from rig.foreign.reading import read_segments
from tests.rig.foreign.test_session_import import FORCE_V, HAMMER_RAD, KEY, MAPPING, TIME, WHIPPEN_DEG

TEXT = "t;Größe (°C)\n0;1,5\n1;-2,25\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_text_of_every_usual_encoding_reads_the_same(encoding, tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(TEXT.encode(encoding))
    (table,) = read_segments(path, separator=";", decimal=",")
    np.testing.assert_array_equal(table.channel("Größe (°C)"), [1.5, -2.25])


def test_an_encoding_that_the_first_bytes_promise_is_kept_to() -> None:
    with pytest.raises(InputError, match="byte 2 is not utf-16-le text"):
        decode_text(b"\xff\xfea\x00b", "a.csv")
    assert decode_text(b"\x81\xe4", "a.csv") == "\x81ä"


@pytest.mark.parametrize(
    ("cell", "value"),
    [("1.234,5", 1234.5), ("-12.345.678", -12345678.0), ("999,25", 999.25), ("1.000e3", 1e6), ("0,001", 0.001)],
)
def test_thousands_dots_that_are_announced_are_read(cell, value) -> None:
    assert parse_csv(f"x\n{cell}\n", "a", ";", ",", ".").channel("x")[0] == value


@pytest.mark.parametrize("cell", ["1.23,5", "0.123", "1.2345", "12345.678", "1.234.56", "1,234.567", ".123"])
def test_what_is_not_whole_groups_is_refused(cell) -> None:
    with pytest.raises(InputError, match="row 1: found"):
        parse_csv(f"x\n{cell}\n", "a", ";", ",", ".").channel("x")


def test_thousands_dots_that_are_not_announced_are_refused_with_advice() -> None:
    with pytest.raises(InputError, match='thousands = "."'):
        parse_csv("x\n1.234\n", "a", ";", ",").channel("x")
    with pytest.raises(InputError, match="thousands = '.' is the decimal sign"):
        parse_mapping('thousands = "."\n' + MAPPING)


def recording(path: Path, times: list[str]) -> Path:
    table = np.column_stack([0.4 - FORCE_V, KEY, WHIPPEN_DEG, HAMMER_RAD])
    rows = (",".join([t, *(repr(float(v)) for v in row)]) for t, row in zip(times, table, strict=True))
    path.write_text("t,load,k,w,h\n" + "\n".join(rows) + "\n")
    return path


def test_a_trial_begins_when_its_file_says(tmp_path) -> None:
    second = [f"2024-02-29T10:15:{t:09.6f}" for t in TIME]
    with_zone = recording(tmp_path / "zone.csv", [f"{t}+01:00" for t in second])
    without = recording(tmp_path / "local.csv", second)
    silent = recording(tmp_path / "silent.csv", [repr(float(t)) for t in TIME])
    session = import_session(tmp_path / "s", [with_zone, without, silent], parse_mapping(MAPPING))
    started = [trial.read().started_utc for trial in Session.open(session.path).trials]
    assert started[:2] == ["2024-02-29T09:15:00+00:00", "2024-02-29T10:15:00"]
    assert datetime.fromisoformat(started[2]).timestamp() == pytest.approx(silent.stat().st_mtime, abs=1.0)
    notes = session.info.notes
    assert "start of trial 1" not in notes and "zone" in notes["start of trial 2"]
    assert "last change" in notes["start of trial 3"]
    told = import_session(tmp_path / "told", [without], parse_mapping("utc_offset_h = -5.0\n" + MAPPING))
    assert told.trials[0].read().started_utc == "2024-02-29T15:15:00+00:00"


def test_tdms_and_lvm_say_when_they_began(tmp_path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    begun = np.datetime64("2024-03-01T12:30:00.250000")
    with path.open("wb") as stream, nptdms.TdmsWriter(stream) as writer:
        properties = {"wf_increment": 2e-4, "wf_start_time": begun}
        writer.write_segment([nptdms.ChannelObject("g", "x", np.arange(5.0), properties)])
    (table,) = read_segments(path)
    assert table.started == "2024-03-01T12:30:00.250000+00:00"
    head = (
        "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tNo\n***End_of_Header***\n\nChannels\t1\n"
    )
    stamp = "Samples\t2\nDate\t2023/12/24\nTime\t18:00:01,5\nX0\t0\nDelta_X\t0.001\n***End_of_Header***\n"
    lvm = f"{head}{stamp}X_Value\tF\n\t1.0\n\t2.0\n"
    (tmp_path / "a.lvm").write_text(lvm, encoding="latin-1")
    (table,) = read_segments(tmp_path / "a.lvm")
    assert table.started == "2023-12-24T18:00:01.500000"
    for time in ("25:00:00", "18:00:9999999999999", "18:inf:00", "18:00:-3"):
        (tmp_path / "a.lvm").write_text(lvm.replace("18:00:01,5", time), encoding="latin-1")
        with pytest.raises(RigInputError, match="allowed YYYY/MM/DD and HH:MM:SS"):
            read_segments(tmp_path / "a.lvm")
