"""The digest kept while a trial is written is that of everything the file then holds."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.configuration.rig_file import load_rig, parse_rig
from rig.recording.recorder import record_session
from tests.rig.lab_channels import READBACK

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


def bytes_sha256(value: Any) -> str:
    array = np.asarray(value)
    if array.dtype.kind in "OUS":
        items = [item.decode() if isinstance(item, bytes) else str(item) for item in array.ravel()]
        return hashlib.sha256("\n".join(items).encode()).hexdigest()
    return hashlib.sha256(np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"))).tobytes()).hexdigest()


def read_back(file: h5py.File) -> str:
    """Digest over all groups and datasets as HDF5 gives them back, by name; not over its own bookkeeping."""
    nodes = {"/": file}
    file.visititems(lambda name, node: nodes.__setitem__(name, node))
    digest = hashlib.sha256()
    for name in sorted(nodes):
        digest.update(name.encode() + b"\0")
        for key in sorted(nodes[name].attrs):
            if not (key.isupper() or key.startswith("_") or (name, key) == ("/", "sha256")):
                digest.update(f"{key}={bytes_sha256(nodes[name].attrs[key])}\0".encode())
        if isinstance(nodes[name], h5py.Dataset):
            digest.update(bytes_sha256(nodes[name][()]).encode())
    return digest.hexdigest()


def assert_digest(path: Path) -> None:
    with h5py.File(path) as file:
        assert file.attrs["sha256"] == read_back(file)


@pytest.mark.parametrize("name", ["virtual", "pcie6363"])
def test_the_digest_is_that_of_what_is_read_back(name, make_backend, step_profile, tmp_path) -> None:
    further = READBACK.replace("wire", "Drähtchen") if name == "pcie6363" else ""
    rig = parse_rig(load_rig(name).text + further, "lab.toml")
    session = record_session(
        tmp_path / "s", profile=step_profile, rig_config=rig, backend=make_backend(rig.config, noise_n=0.02), trials=1
    )
    assert_digest(session.trials[0].path)
    with h5py.File(session.trials[0].path) as file:
        assert ("motor_readback" in file["daq"]) == (name == "pcie6363") and "camera" in file


def test_a_trial_written_by_an_earlier_version_has_the_same_kind_of_digest() -> None:
    for path in sorted(SHIPPED.glob("trial_*.h5")):
        assert_digest(path)
