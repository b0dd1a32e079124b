"""Recordings as text, each with what "right" means by a second, independent reading."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from rig.foreign.csv_file import parse_csv
from rig.foreign.lvm_file import parse_lvm
from tests.rig.foreign.test_readers import file_of, segment
from tests.rig.fuzz.damage import Case, text


def csv_case(folder: Path) -> Case:
    rows = "\n".join(f"{k * 2e-4:.4f},{np.sin(k):.5f},{k * 3}" for k in range(30))
    return f"# made by hand\ntime_s,force_n,count\n{rows}\n".encode(), *_csv_reading(",", ".")


def european_csv_case(folder: Path) -> Case:
    rows = "\n".join(f"{k * 2e-4:.4f};{np.sin(k):.5f};{k * 3};".replace(".", ",") for k in range(30))
    return f"\ufeffZeit;Kraft (N);Weg;\ns;N;counts;\n{rows}\n".encode(), *_csv_reading(";", ",")


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell))) and "_" not in cell
    except ValueError:
        return False


def _csv_reading(separator: str, decimal: str) -> tuple[Any, Any]:
    def read(data: bytes) -> Any:
        table = parse_csv(text(data), "a.csv", separator, decimal)
        for name in [*table.channels, *table.unreadable]:
            table.channel(name)
        return table

    def right(data: bytes, found: Any) -> None:
        lines = [line for line in data.decode("utf-8-sig").splitlines() if line.strip() and not line.startswith("#")]
        head, *body = csv.reader(io.StringIO("\n".join(lines)), delimiter=separator)
        if all(_is_number(cell.replace(decimal, ".")) for cell in head if cell.strip()):  # the names stand above them
            above = data.decode("utf-8-sig").partition(lines[0])[0].splitlines()
            head, body = [cell.lstrip("# ") for cell in above[-1].split(separator)], [head, *body]
        names = [name.strip() for name in head]
        assert {name for name in names if name} == set(found.channels) | set(found.unreadable)
        values = next(iter(found.channels.values()))
        body = body[len(body) - values.size :]  # a row of units is not one of numbers
        for name, column in found.channels.items():
            assert np.all(np.isfinite(column))
            if found.units.get(name) != "s" or ":" not in "".join(row[names.index(name)] for row in body):
                assert [float(row[names.index(name)].replace(decimal, ".")) for row in body] == column.tolist()

    return read, right


def logger_csv_case(folder: Path) -> Case:
    """Lines above the names, units that are not known, groups of three digits with no-break spaces."""
    rows = "\n".join(f"{k * 2e-4:.4f};{1e3 + 100 * k:,.2f};bar{k};{k}".replace(",", "\u202f") for k in range(30))
    whole = f"sep=;\nLogger 3\nRate;5000\nt;p;note;k\ns;bar;m/s^2;counts\n{rows}\n"

    def read(data: bytes) -> Any:
        return parse_csv(text(data), "a.csv", ";", ".", " ", names_row=4)

    def right(data: bytes, found: Any) -> None:
        body = data.decode("utf-8-sig").splitlines()[3:]
        head, *body = csv.reader(io.StringIO("\n".join(x for x in body if x.strip() and x[0] != "#")), delimiter=";")
        names = [name.strip() for name in head]
        for name, column in found.channels.items():
            cells = [row[names.index(name.lstrip("# "))] for row in body[len(body) - column.size :]]
            if ":" not in "".join(cells):
                plain = [cell.replace("\u202f", "").replace("\u00a0", "").replace(" ", "") for cell in cells]
                assert [float(cell) for cell in plain] == column.tolist()

    return whole.encode(), read, right


def _lvm_right(data: bytes, found: Any) -> None:
    assert all(clock.interval_s > 0 for table in found for clock in table.clocks.values())
    for table in found:
        sizes = {values.size for values in table.channels.values()}
        assert len(sizes) == 1 and all(np.all(np.isfinite(values)) for values in table.channels.values())
    content = data.decode("utf-8-sig", "replace")
    sign = "," if "Decimal_Separator\t," in content else "."
    separator = "," if "Separator,Comma" in content else "\t"
    last = [line for line in content.split("\n") if line.strip()][-1].rstrip("\r").split(separator)
    columns = [values for name, values in found[-1].channels.items() if name != "X_Value"]
    assert [float(cell.replace(sign, ".")) for cell in last[1 : len(columns) + 1]] == [v[-1] for v in columns]


def _lvm(data: bytes) -> Any:
    return parse_lvm(data.decode("utf-8-sig", "replace"), "a.lvm")


def segments_case(folder: Path) -> Case:
    whole = file_of(segment(2e-4, 0.0, 1, "10:00:00.5"), segment(5e-4, 3.0, 2, "10:00:07")).replace("\tbegun", "")
    return whole.encode(), _lvm, _lvm_right
