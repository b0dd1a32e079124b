"""Damaged text of every reader: an error of one line or the right values, never a traceback, a hang or a wrong number.

What "right" means is told by a second, independent reading of the same bytes.
"""

from __future__ import annotations

import csv
import io
import tomllib
from typing import Any

import numpy as np
import pytest

from rig.config import load_rig, parse_rig
from rig.foreign.csv_text import parse_csv
from rig.foreign.lvm_text import parse_lvm
from rig.foreign.mapping import parse_mapping
from rig.profile import load_profile, parse_profile
from rig.trial_plan import parse_plan
from tests.rig.foreign.test_session_import import MAPPING
from tests.rig.fuzz.damage import COUNTS, same_values, survive, text


def rig_case() -> tuple[bytes, Any, Any]:
    return load_rig("virtual").text.encode(), lambda data: parse_rig(text(data)), _rig_is_right


def _rig_is_right(data: bytes, found: Any) -> None:
    same_values(tomllib.loads(data.decode()), found.config)


def profile_case() -> tuple[bytes, Any, Any]:
    return load_profile("piano").text.encode(), lambda data: parse_profile(text(data)), _profile_is_right


def _profile_is_right(data: bytes, found: Any) -> None:
    points = tomllib.loads(data.decode())["points"]
    np.testing.assert_array_equal(found.time_s, [point["time_s"] for point in points])
    np.testing.assert_array_equal(found.force_n, [point["force_n"] for point in points])
    assert np.all(np.isfinite(found.sample(5000.0))) and found.force_n[0] == found.force_n[-1] == 0


def plan_case() -> tuple[bytes, Any, Any]:
    whole = (
        "# a comment that says at some length what this plan is for, so that damage may also do no harm at all\n"
        'schema = "piano-action-rig plan 1"\nname = "p"\nseed = 7\nrest_s = 1.5\nwarm_up = 1\norder = "blocks"\n'
        '[[conditions]]\nname = "a"\nprofile = "forte"\nrepeats = 3\n'
        '[[conditions]]\nname = "b"\nprofile = "piano"\nrepeats = 2\nprompt = "x"\n[room]\ntemperature_c = 21.0\n'
    )

    def right(data: bytes, found: Any) -> None:
        plain = tomllib.loads(data.decode())
        count = plain.get("warm_up", 0) + sum(c.get("repeats", 1) for c in plain["conditions"])
        assert len(found.entries) == count and found.rest_s == plain.get("rest_s", 0)

    return whole.encode(), lambda data: parse_plan(text(data)), right


def mapping_case() -> tuple[bytes, Any, Any]:
    def right(data: bytes, found: Any) -> None:
        same_values(tomllib.loads(data.decode()), found.config)

    return MAPPING.encode(), lambda data: parse_mapping(text(data)), right


def csv_case() -> tuple[bytes, Any, Any]:
    rows = "\n".join(f"{k * 2e-4:.4f},{np.sin(k):.5f},{k * 3}" for k in range(30))
    whole = f"# made by hand\ntime_s,force_n,count\n{rows}\n".encode()

    def right(data: bytes, found: Any) -> None:
        lines = [line for line in data.decode("utf-8-sig").splitlines() if line.strip() and not line.startswith("#")]
        head, *body = csv.reader(io.StringIO("\n".join(lines)))
        names = [name.strip() for name in head]
        assert {name for name in names if name} == set(found.channels) | set(found.unreadable)
        for name, values in found.channels.items():
            assert [float(row[names.index(name)]) for row in body] == values.tolist() and np.all(np.isfinite(values))

    def read(data: bytes) -> Any:
        table = parse_csv(text(data), "a.csv")
        for name in [*table.channels, *table.unreadable]:
            table.channel(name)
        return table

    return whole, read, right


def lvm_case() -> tuple[bytes, Any, Any]:
    head = (
        "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\n"
        "Channels\t2\nSamples\t30\t30\nY_Unit_Label\tN\tdeg\nX0\t0\t0\nDelta_X\t0.0002\t0.0002\n***End_of_Header***\n"
        "X_Value\tForce\tKey\tComment\n"
    )
    rows = "\n".join(f"{k * 2e-4:.4f}\t{np.sin(k):.5f}\t{k * 3}" for k in range(30))

    def right(data: bytes, found: Any) -> None:
        assert all(clock.interval_s > 0 for table in found for clock in table.clocks.values())
        for table in found:
            sizes = {values.size for values in table.channels.values()}
            assert len(sizes) == 1 and all(np.all(np.isfinite(values)) for values in table.channels.values())
        content = data.decode("utf-8-sig", "replace")
        sign = "," if "Decimal_Separator\t," in content else "."
        separator = "," if "Separator,Comma" in content else "\t"
        last = [line for line in content.split("\n") if line.strip()][-1].rstrip("\r").split(separator)
        for cell, values in zip(last[1:], list(found[-1].channels.values()), strict=False):
            assert float(cell.replace(sign, ".")) == values[-1]

    return (head + rows + "\n").encode(), lambda data: parse_lvm(data.decode("utf-8-sig", "replace"), "a.lvm"), right


CASES = {
    "rig": rig_case,
    "profile": profile_case,
    "plan": plan_case,
    "mapping": mapping_case,
    "csv": csv_case,
    "lvm": lvm_case,
}


@pytest.mark.parametrize("inputs", COUNTS)
@pytest.mark.parametrize("name", CASES)
def test_text_is_read_right_or_refused(name: str, inputs: int) -> None:
    whole, read, check = CASES[name]()
    refused = survive(whole, read, check, inputs)
    assert 0 < refused < inputs  # the damage neither spares nor spoils everything
