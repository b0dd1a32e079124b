"""Exported trials: every column reads back to the sealed trial's own numbers, with its unit; nothing is overwritten."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig import ChannelInfo, InputError, TrialData, read_channels
from rig.session.trial_export import export_trial, list_columns
from tests.rig.session.test_sealed_trial import trial

ACCELERATION = ChannelInfo("key_acceleration", "acceleration of the key", "m/s^2", "x", "y", (0.0, 1.0), (0.0, 9.8))


@pytest.fixture
def data() -> TrialData:
    random = np.random.default_rng(4)
    values = random.normal(size=(200, 1)) * np.pi
    return trial(200, raw_force_n=random.normal(size=200) / 3, channels=(ACCELERATION,), channel_values=values)


def expected(data: TrialData) -> dict[str, tuple[str, np.ndarray]]:
    return {c.name: (c.unit, c.values) for c in list_columns(data)}


def read_csv(path: Path) -> dict[str, tuple[str, Any]]:
    described = json.loads(Path(f"{path}-metadata.json").read_text())
    assert described["url"] == path.name and described["notes"][0]["status"] == "complete"
    units = {c["name"]: c["schema:unitText"] for c in described["tableSchema"]["columns"]}
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: (units[name], table[name]) for name in table.dtype.names}


def read_mat(path: Path) -> dict[str, tuple[str, Any]]:
    from scipy.io import loadmat

    found = loadmat(path, simplify_cells=True)
    assert found["about"]["trial"] == 1 and "counter-clockwise" in found["meanings"]["key_rad"]
    return {name: (unit, found[name]) for name, unit in found["units"].items()}


def read_tdms(path: Path) -> dict[str, tuple[str, Any]]:
    nptdms = pytest.importorskip("nptdms")
    file = nptdms.TdmsFile.read(path)
    assert file.properties["status"] == "complete" and file["daq"]["force_n"].properties["wf_increment"] == 2e-4
    again = read_channels(path)
    np.testing.assert_array_equal(again.channel("raw_force_n"), file["daq"]["raw_force_n"][:])
    return {c.name: (c.properties["unit_string"], c[:]) for c in file["daq"].channels()}


def read_parquet(path: Path) -> dict[str, tuple[str, Any]]:
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = parquet.read_table(path)
    assert table.schema.metadata[b"status"] == b"complete"
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    return {name: (units[name], table[name].to_numpy()) for name in table.column_names}


@pytest.mark.parametrize("read", [read_csv, read_mat, read_tdms, read_parquet])
def test_every_column_reads_back_with_its_unit(read, data, tmp_path) -> None:
    form = read.__name__.removeprefix("read_")
    if form == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"trial_0001.{form}"
    assert path in export_trial(data, path)
    found, wanted = read(path), expected(data)
    assert list(found) == list(wanted)
    for name, (unit, values) in wanted.items():
        assert found[name][0] == unit
        np.testing.assert_array_equal(np.ravel(found[name][1]), values)
    with pytest.raises(InputError, match="exists already"):
        export_trial(data, path)


def test_what_is_not_possible_is_refused_and_leaves_nothing(data, tmp_path, monkeypatch) -> None:
    with pytest.raises(InputError, match=r"ending found '.xls', allowed .csv, .mat, .tdms, .parquet"):
        export_trial(data, tmp_path / "a.xls")
    for package, form in (("nptdms", "tdms"), ("pyarrow", "parquet")):
        monkeypatch.setitem(__import__("sys").modules, package, None)
        with pytest.raises(InputError, match=rf"piano-action-rig\[{form}\]"):
            export_trial(data, tmp_path / f"a.{form}")
    (tmp_path / "b.csv-metadata.json").write_text("mine")
    with pytest.raises(InputError, match="b.csv-metadata.json: exists already"):
        export_trial(data, tmp_path / "b.csv")
    assert [file.name for file in tmp_path.iterdir()] == ["b.csv-metadata.json"]


def test_a_trial_without_samples_or_encoders_is_exported(tmp_path) -> None:
    bare = replace(
        trial(0, camera=None), encoders=(), encoder_count=np.empty((0, 0), dtype=np.int64), status="incomplete"
    )
    export_trial(bare, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == "time_s,force_n,raw_force_n,force_raw,motor_command_v\n"
