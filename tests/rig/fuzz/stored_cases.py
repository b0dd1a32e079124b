"""TDMS, sessions and journals, each with what "right" means.

A checksum guards sealed trials and journals; a TDMS file has none and is read again with npTDMS.
"""

from __future__ import annotations

import io
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig import Block, ChannelInfo, MotorCommand, Session, Timing, load_rig, read_channels
from rig.session.journal_records import BLOCK, COMMAND, HEAD, Journal, decode_blocks, encode, encode_block, scan
from rig.session.trial_head import TrialHead
from tests.rig.foreign import tdms_bytes
from tests.rig.fuzz.damage import Case, same_values

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


def tdms_case(folder: Path) -> Case:
    nptdms = pytest.importorskip("nptdms")
    path = folder / "a.tdms"
    with nptdms.TdmsWriter(path) as writer:
        for part in range(2):
            values = np.sin(np.arange(20.0) + part)
            writer.write_segment([
                nptdms.ChannelObject("g", "Force", values, {"wf_increment": 2e-4, "unit_string": "N"}),
                nptdms.ChannelObject("g", "Key", np.arange(20, dtype=np.int32)),
            ])  # fmt: skip
    return path.read_bytes(), *_tdms_reading(path)


def big_endian_tdms_case(folder: Path) -> Case:
    columns = {"Force": np.sin(np.arange(20.0)), "Key": np.arange(20.0)}
    data = tdms_bytes.doubles(columns, {"wf_increment": 2e-4, "unit_string": "N"}, big=True, interleaved=True)
    return data + data, *_tdms_reading(folder / "a.tdms")


def _tdms_reading(path: Path) -> tuple[Any, Any]:
    nptdms = pytest.importorskip("nptdms")

    def read(data: bytes) -> Any:
        path.write_bytes(data)
        table = read_channels(path)
        table.check_together(list(table.channels))
        return table

    def right(data: bytes, found: Any) -> None:
        assert len({values.size for values in found.channels.values()}) == 1
        assert sum(values.size for values in found.channels.values()) <= 16 * len(data)
        if set(found.channels) == {"Force", "Key"} and data == path.read_bytes():
            with nptdms.TdmsFile.open(path) as file:
                named = (c for group in file.groups() for c in group.channels() if c.name == "Force" and len(c))
                again = next(named)[:]
            np.testing.assert_array_equal(found.channels["Force"], again.astype(float))

    return read, right


def hdf5_case(folder: Path) -> Case:
    """A table of named columns and a dataset of integers with a scale."""
    path = folder / "a.h5"
    with h5py.File(path, "w") as file:
        file["run"] = np.rec.fromarrays([np.arange(20) * 2e-4, np.arange(20)], names=["t", "key"])
        file["force"] = np.arange(20, dtype=np.int16).reshape(1, 20)
        file["force"].attrs.update({"scale_factor": 0.5, "add_offset": -1.0, "units": np.bytes_("N")})

    def read(data: bytes) -> Any:
        path.write_bytes(data)
        return read_channels(path)

    def right(data: bytes, found: Any) -> None:
        with h5py.File(path) as file:
            node = file.get("force")
            if (
                node is None
                or "force" not in found.channels
                or set(node.attrs) != {"scale_factor", "add_offset", "units"}
            ):
                return
            expected = node[()].ravel() * float(node.attrs["scale_factor"]) + float(node.attrs["add_offset"])
        np.testing.assert_array_equal(found.channels["force"], expected)

    return path.read_bytes(), read, right


def _session(folder: Path) -> dict[str, bytes]:
    """A session's texts, put into the folder."""
    notes = [{"trial": k, "kind": "note", "reason": "é", "author": "a", "time_utc": "2026"} for k in range(1, 4)]
    texts = {
        "session.toml": (SHIPPED / "session.toml").read_bytes(),
        "annotations.jsonl": b"".join(json.dumps(note).encode() + b"\n" for note in notes),
    }
    for name, whole in texts.items():
        (folder / name).write_bytes(whole)
    return texts


def session_case(folder: Path) -> Case:
    whole = _session(folder)["session.toml"]

    def read(data: bytes) -> Any:
        (folder / "session.toml").write_bytes(data)
        return Session.open(folder, require_trials=False)

    def right(data: bytes, found: Any) -> None:
        same_values(tomllib.loads(data.decode()), found.info)

    return whole, read, right


def annotations_case(folder: Path) -> Case:
    whole = _session(folder)["annotations.jsonl"]
    session = Session.open(folder, require_trials=False)

    def read(data: bytes) -> Any:
        (folder / "annotations.jsonl").write_bytes(data)
        return session.annotations

    def right(data: bytes, found: Any) -> None:
        lines = [json.loads(line) for line in data.decode().splitlines() if line.strip()]
        assert [(a.trial, a.kind, a.reason) for a in found] == [(x["trial"], x["kind"], x["reason"]) for x in lines]
        assert all(type(a.trial) is int and isinstance(a.reason, str) and a.reason.strip() for a in found)

    return whole, read, right


def trial_case(folder: Path) -> Case:
    _session(folder)
    whole, path = (SHIPPED / "trial_0001.h5").read_bytes(), folder / "trial_0001.h5"
    reference = Session.open(SHIPPED).trials[0].read()

    def read(data: bytes) -> Any:
        path.write_bytes(data)
        return Session.open(folder).trial(1).read()

    def right(data: bytes, found: Any) -> None:
        assert data == whole
        np.testing.assert_array_equal(found.raw_force_n, reference.raw_force_n)

    return whole, read, right


def journal_in(data: bytes) -> tuple[Journal, list[Block]]:
    """What a journal of these bytes holds, and its blocks."""
    found = scan(io.BytesIO(data))
    return found, list(decode_blocks(io.BytesIO(data), found))


def journal_case(folder: Path) -> Case:
    """A journal is never refused, only read as far as it is whole."""
    config = load_rig("virtual").config
    further = ChannelInfo("current", "current of the motor", "A", "drive", "data sheet", (0.0, 1.0), (0.0, 3.0))
    head = TrialHead.from_rig(config, Timing(5000.0, 0), MotorCommand(np.zeros(10), 0.1, 0.2), number=1, simulated=True)
    head = replace(head, channels=(further,))
    counts = np.arange(15, dtype=np.int64).reshape(5, 3)
    blocks = [
        Block(5 * k, np.arange(5.0) + k, np.arange(5.0) - k, counts * (k + 1), None, 0.1 * k + counts[:, :1])
        for k in range(8)
    ]
    whole = encode(HEAD, 0, 0, 0, json.dumps(head.to_plain()).encode())
    whole += encode(COMMAND, 1, 0, 10, np.zeros(10).tobytes())
    for k, block in enumerate(blocks):
        whole += encode(BLOCK, k + 2, block.first_sample, 5, encode_block(block))

    def right(data: bytes, found: Any) -> None:
        for got, wanted in zip(found[1], blocks, strict=False):
            np.testing.assert_array_equal(got.force_n, wanted.force_n)
            np.testing.assert_array_equal(got.encoder_count, wanted.encoder_count)
            np.testing.assert_array_equal(got.channel_values, wanted.channel_values)
        assert len(found[1]) <= len(blocks)

    return whole, journal_in, right
