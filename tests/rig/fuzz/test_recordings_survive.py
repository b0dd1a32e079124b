"""Damaged recordings of every kind: an error of one line or the right values, never a traceback or a wrong number.

A checksum guards sealed trials and journals; a TDMS file has none and is read again with npTDMS.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.config import load_rig
from rig.foreign.reading import read_channels
from rig.session import Session
from rig.session.journal_format import parse as parse_journal
from tests.rig.fuzz.damage import COUNTS, same_values, survive

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


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
        table = read_channels(path)
        table.check_together(list(table.channels))
        return table

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
