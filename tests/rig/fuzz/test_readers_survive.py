"""Damaged input of every reader: an error of one line or the right values, never a traceback, a hang or a wrong number.

The short form runs a few hundred damaged inputs of each reader, the slow one 10,000. What "right" means is told by a
second, independent reading of the same bytes, or by the undamaged file where a checksum guards it.
"""

from __future__ import annotations

import csv
import io
import json
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.config import load_rig, parse_rig
from rig.errors import InputError
from rig.foreign.csv_text import parse_csv
from rig.foreign.lvm_text import parse_lvm
from rig.foreign.mapping import parse_mapping
from rig.foreign.reading import read_channels
from rig.profile import load_profile, parse_profile
from rig.session import Session
from rig.session.journal_format import parse as parse_journal
from rig.trial_plan import parse_plan

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"
LONGEST_S = 5.0
TOKENS = [
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"1_000", b"0x10", b"99999999999999999999", b"''", b'"', b"[",
    b"]", b"{", b"}", b"=", b",", b";", b"\t", b"\n", b"\0", b"\xff", b"true", b"1979-05-27", b"#", b".", b"e",
    b"\xe2\x88\x92",
]  # fmt: skip


def damaged(whole: bytes, chance: np.random.Generator) -> bytes:
    """One to four changes: a byte flipped, a stretch lost, doubled or moved, a token put in, the end cut off."""
    data = bytearray(whole)
    for _ in range(int(chance.integers(1, 5))):
        if not data:
            break
        at = int(chance.integers(0, len(data)))
        end = min(len(data), at + int(chance.integers(1, 40)))
        match int(chance.integers(0, 7)):
            case 0:
                data[at] ^= 1 << int(chance.integers(0, 8))
            case 1:
                del data[at:end]
            case 2:
                data[at:at] = data[at:end]
            case 3:
                part = bytes(data[at:end])
                del data[at:end]
                to = int(chance.integers(0, len(data) + 1))
                data[to:to] = part
            case 4:
                data[at:at] = TOKENS[int(chance.integers(0, len(TOKENS)))]
            case 5:
                data[at:end] = TOKENS[int(chance.integers(0, len(TOKENS)))]
            case _:
                del data[at:]
    return bytes(data)


MAPPING = """
schema = "piano-action-rig mapping 1"
simulated = false
operator = "eva"
mains_frequency_hz = 50.0
[time]
channel = "t"
[force]
channel = "load"
unit = "V"
newtons_per_unit = -25.0
zero = 0.2
group_delay_s = 1e-3
[[encoders]]
name = "key"
channel = "k"
unit = "counts"
counts_per_revolution = 327680
sign = 1
[[encoders]]
name = "whippen"
channel = "w"
unit = "deg"
counts_per_revolution = 3600000
sign = 1
[[encoders]]
name = "hammer"
channel = "h"
unit = "rad"
counts_per_revolution = 6283185
sign = -1
"""


def survive(whole: bytes, read: Callable[[bytes], Any], check: Callable[[bytes, Any], None], inputs: int) -> int:
    """Read damaged inputs; return how many were refused. The first input is whole."""
    chance, refused = np.random.default_rng(52), 0
    check(whole, read(whole))
    for _ in range(inputs):
        data = damaged(whole, chance)
        began = time.process_time()
        try:
            found = read(data)
        except InputError as error:
            assert "\n" not in str(error) and len(str(error)) < 2000
            refused += 1
        else:
            check(data, found)
        assert time.process_time() - began < LONGEST_S, data[:200]
    return refused


def text(data: bytes) -> str:
    """Bytes as the readers of files see them."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is not UTF-8") from error


def same_values(plain: Any, model: Any) -> None:
    """Every value a TOML reader finds is the value in the checked settings."""
    for key, value in plain.items():
        names = {field.alias or name: name for name, field in type(model).model_fields.items()}
        found = getattr(model, names[key])
        if isinstance(value, dict) and hasattr(type(found), "model_fields"):
            same_values(value, found)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            assert len(value) == len(found)
            for one, other in zip(value, found, strict=True):
                same_values(one, other)
        elif isinstance(value, list):
            assert list(found) == value
        elif not isinstance(value, dict) and not hasattr(type(found), "model_fields"):
            assert found == value, (key, value, found)


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
        assert [name.strip() for name in head] == list(found.channels)
        for k, values in enumerate(found.channels.values()):
            assert [float(row[k]) for row in body] == values.tolist() and np.all(np.isfinite(values))

    return whole, lambda data: parse_csv(text(data), "a.csv"), right


def lvm_case() -> tuple[bytes, Any, Any]:
    head = (
        "LabVIEW Measurement\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\n"
        "Channels\t2\nSamples\t30\t30\nY_Unit_Label\tN\tdeg\nX0\t0\t0\nDelta_X\t0.0002\t0.0002\n***End_of_Header***\n"
        "X_Value\tForce\tKey\tComment\n"
    )
    rows = "\n".join(f"{k * 2e-4:.4f}\t{np.sin(k):.5f}\t{k * 3}" for k in range(30))

    def right(data: bytes, found: Any) -> None:
        sizes = {values.size for values in found.channels.values()}
        assert len(sizes) == 1 and all(np.all(np.isfinite(values)) for values in found.channels.values())
        assert found.interval_s is None or found.interval_s > 0
        content = data.decode("utf-8-sig", "replace")
        sign = "," if "Decimal_Separator\t," in content else "."
        separator = "," if "Separator,Comma" in content else "\t"
        last = [line for line in content.split("\n") if line.strip()][-1].rstrip("\r").split(separator)
        for cell, values in zip(last[1:], list(found.channels.values())[1:], strict=False):
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
COUNTS = [150, pytest.param(10_000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("inputs", COUNTS)
@pytest.mark.parametrize("name", CASES)
def test_text_is_read_right_or_refused(name: str, inputs: int) -> None:
    whole, read, check = CASES[name]()
    refused = survive(whole, read, check, inputs)
    assert 0 < refused < inputs  # the damage neither spares nor spoils everything


@pytest.mark.parametrize("inputs", COUNTS)
def test_tdms_is_read_or_refused(tmp_path: Path, inputs: int) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as writer:
        for part in range(2):
            values = np.sin(np.arange(20.0) + part)
            writer.write_segment([
                nptdms.ChannelObject("g", "Force", values, {"wf_increment": 2e-4, "unit_string": "N"}),
                nptdms.ChannelObject("g", "Key", np.arange(20, dtype=np.int32)),
            ])  # fmt: skip

    def read(data: bytes) -> Any:
        path.write_bytes(data)
        return read_channels(path)

    def right(data: bytes, found: Any) -> None:
        assert len({values.size for values in found.channels.values()}) == 1
        assert sum(values.size for values in found.channels.values()) <= 16 * len(data)
        if set(found.channels) == {"Force", "Key"} and data == path.read_bytes():
            with nptdms.TdmsFile.open(path) as file:
                again = file.groups()[0]["Force"][:]
            np.testing.assert_array_equal(found.channels["Force"], again.astype(float))

    assert survive(path.read_bytes(), read, right, inputs) > inputs // 3


@pytest.mark.parametrize("inputs", COUNTS)
def test_a_session_is_read_as_it_was_or_refused(tmp_path: Path, inputs: int) -> None:
    texts = {
        "session.toml": (SHIPPED / "session.toml").read_bytes(),
        "annotations.jsonl": b"".join(
            json.dumps({"trial": k, "kind": "note", "reason": "é", "author": "a", "time_utc": "2026"}).encode() + b"\n"
            for k in range(1, 4)
        ),
    }
    folder = tmp_path / "s"
    folder.mkdir()
    for name, whole in texts.items():
        (folder / name).write_bytes(whole)
    trial = (SHIPPED / "trial_0001.h5").read_bytes()
    for name, whole in texts.items():

        def read(data: bytes, name: str = name) -> Any:
            (folder / name).write_bytes(data)
            session = Session.open(folder, require_trials=False)
            return session, session.annotations, session.trials

        def right(data: bytes, found: Any, name: str = name) -> None:
            if name == "session.toml":
                same_values(tomllib.loads(data.decode()), found[0].info)
            else:
                lines = [json.loads(line) for line in data.decode().splitlines() if line.strip()]
                assert [(a.trial, a.kind, a.reason) for a in found[1]] == [
                    (line["trial"], line["kind"], line["reason"]) for line in lines
                ]

        assert survive(whole, read, right, inputs // 2) > 0
        (folder / name).write_bytes(whole)
    reference = Session.open(SHIPPED).trials[0].read()
    path = folder / "trial_0001.h5"

    def read_trial(data: bytes) -> Any:
        path.write_bytes(data)
        return Session.open(folder).trial(1).read()

    def same(data: bytes, found: Any) -> None:
        assert data == trial
        np.testing.assert_array_equal(found.force_n, reference.force_n)

    few = max(inputs // 10, 10)
    assert survive(trial, read_trial, same, few) >= few - few // 20


@pytest.mark.parametrize("inputs", COUNTS)
def test_a_journal_gives_the_beginning_of_what_was_written(inputs: int, tmp_path: Path) -> None:
    from rig.backend import Block, Timing
    from rig.session.journal_format import BLOCK, COMMAND, HEAD, block_payload, encode
    from rig.session.trial_head import TrialHead
    from rig.trial_run import _encoders, _force_info

    config = load_rig("virtual").config
    head = TrialHead(
        1, "2026", True, 5000.0, 0.1, np.zeros(10), _encoders(config), _force_info(config, Timing(5000.0, 0))
    )
    blocks = [
        Block(5 * k, np.arange(5.0) + k, np.arange(5.0) - k, np.arange(15, dtype=np.int64).reshape(5, 3) * (k + 1))
        for k in range(8)
    ]
    whole = encode(HEAD, 0, 0, 0, json.dumps(head.to_plain()).encode())
    whole += encode(COMMAND, 1, 0, 10, np.zeros(10).tobytes())
    for k, block in enumerate(blocks):
        whole += encode(BLOCK, k + 2, block.first_sample, 5, block_payload(block))

    def right(data: bytes, found: Any) -> None:
        for got, wanted in zip(found.blocks, blocks, strict=False):
            np.testing.assert_array_equal(got.force_n, wanted.force_n)
            np.testing.assert_array_equal(got.encoder_count, wanted.encoder_count)
        assert len(found.blocks) <= len(blocks)

    assert (
        survive(whole, parse_journal, right, inputs) == 0
    )  # a journal is never refused, only read as far as it is whole
