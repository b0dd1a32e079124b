"""Trial files: what is written is read back, sealed, and open to netCDF tools.

Codes of the converter: exactly what was converted, or nothing.

The digest kept while a trial is written is that of everything the file then holds.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rig import CameraInfo, EncoderInfo, ForceInfo, InputError, TrialData, load_rig, parse_rig
from rig.session.converter_codes import NO_CODE, force_codes
from rig.session.sealed_trial import read_status, read_trial, write_trial
from tests.rig.lab_channels import READBACK

ENCODERS = (
    EncoderInfo("key", 327680, 1, "ctr0", 1e-4),
    EncoderInfo("whippen", 327680, -1, "ctr1"),
    EncoderInfo("hammer", 163840, -1, "ctr2"),
)
FORCE = ForceInfo("cell", "two points", (0.0, 2.0), (0.0, 111.2), group_delay_s=0.008, u_noise_n=0.02, preload_n=0.05)
CAMERA = CameraInfo(2000.0, 0.00105, 1e-4, 37, 1e-6)


def trial(n: int = 200, **changes) -> TrialData:
    k = np.arange(n)
    data = TrialData(
        number=1,
        status="complete",
        started_utc="2026-11-21T08:00:00+00:00",
        simulated=True,
        sample_rate_hz=5000.0,
        time_s=k / 5000,
        raw_force_n=0.5 * k,
        force_raw=-0.01 * k,
        motor_command_v=np.sin(k),
        encoder_count=np.column_stack([k, 2 * k, -3 * k]).astype(np.int64),
        encoders=ENCODERS,
        force_info=FORCE,
        camera=CAMERA,
        blow_start_s=0.4,
    )
    return replace(data, **changes)


def assert_same(a: TrialData, b: TrialData) -> None:
    for field in fields(TrialData):
        left, right = getattr(a, field.name), getattr(b, field.name)
        if isinstance(left, np.ndarray):
            assert left.dtype == right.dtype
            np.testing.assert_array_equal(left, right)
        elif field.name != "sha256":
            assert left == right, field.name


finite = st.floats(allow_nan=True, allow_infinity=True, width=64)
text = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=30)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), n=st.integers(0, 30), reason=text, with_camera=st.booleans())
def test_any_trial_survives_a_round_trip_bit_by_bit(tmp_path, data, n, reason, with_camera) -> None:
    path = tmp_path / "t.h5"
    path.unlink(missing_ok=True)
    written = trial(
        n,
        status=data.draw(st.sampled_from(["complete", "not at rest", "interrupted", "fault"])),
        reason=reason,
        raw_force_n=data.draw(arrays(np.float64, n, elements=finite)),
        force_raw=data.draw(arrays(np.float64, n, elements=finite)),
        encoder_count=data.draw(arrays(np.int64, (n, 3))),
        camera=CAMERA if with_camera else None,
    )
    seal = write_trial(path, written)
    read = read_trial(path)
    assert_same(written, read)
    assert read.sha256 == seal == read_status(path)[1]


def test_xarray_opens_the_groups_with_named_dimensions_and_units(tmp_path) -> None:
    write_trial(tmp_path / "t.h5", trial())
    with xr.open_dataset(tmp_path / "t.h5", engine="h5netcdf", group="daq") as daq:
        assert dict(daq.sizes) == {"time": 200, "encoder": 3}
        assert daq.force.attrs["units"] == "N" and daq.force_raw.attrs["units"] == "mV/V"
        assert daq.force.attrs["group_delay_s"] == 0.008
        assert daq.encoder_count.dtype == np.int64
        assert daq.encoder_count.sel(encoder="whippen").values[3] == 6
        assert daq.time.values[5] == 0.001
        assert (daq.attrs["n_valid"], daq.attrs["status"]) == (200, "complete")
    with xr.open_dataset(tmp_path / "t.h5", engine="h5netcdf", group="camera") as camera:
        assert camera.sizes["time"] == 37
        assert camera.time.values[2] == pytest.approx(0.00205)


def test_angles_follow_sign_and_counts_per_revolution_and_start_at_zero() -> None:
    data = trial(3, encoder_count=np.array([[5, 5, 5], [6, 6, 6], [5 + 327680, 5, 5 - 163840]], dtype=np.int64))
    step = 2 * np.pi / 327680
    expected = [[0, 0, 0], [step, -step, -2 * step], [2 * np.pi, 0, 2 * np.pi]]
    np.testing.assert_allclose(data.angle_rad, expected, atol=1e-15)


def test_no_changed_byte_reaches_the_hdf5_library(tmp_path) -> None:
    """The library crashes the process on some of these files."""
    path = tmp_path / "t.h5"
    write_trial(path, trial(20))
    path.chmod(0o644)
    whole, random = path.read_bytes(), np.random.default_rng(1)
    for place in random.integers(len(whole), size=300):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        with pytest.raises(InputError):
            read_trial(path)


def test_wrong_shapes_broken_counts_and_unknown_states_are_refused_before_writing(tmp_path) -> None:
    for changes in (
        {"force_raw": np.zeros(3)},
        {"encoder_count": np.zeros((200, 2), dtype=np.int64)},
        {"encoder_count": np.full((200, 3), 0.5)},
        {"status": "fine"},
    ):
        with pytest.raises(InputError):
            write_trial(tmp_path / "t.h5", trial(**changes))
    assert list(tmp_path.iterdir()) == []


def test_a_sealed_trial_is_never_replaced(tmp_path) -> None:
    write_trial(tmp_path / "t.h5", trial())
    with pytest.raises(InputError, match="never replaced"):
        write_trial(tmp_path / "t.h5", trial())


STEP = 2 * 0.025 / 2**24
CUBIC = (3.1e-4, 3.05e-4, -2.0e-14, 4.0e-20)
"""Like those of an X Series card: 16 bits, some parts in a thousand off the straight line at the ends."""


def force_info(scaling: tuple[float, ...], unit: str) -> ForceInfo:
    return replace(FORCE, device_scaling=scaling, electrical_unit=unit)


def test_every_code_of_a_bridge_survives_the_way_through_the_force() -> None:
    info = force_info((0.0, STEP), "mV/V")
    code = np.unique(np.concatenate([np.arange(-(2**23), 2**23, 4099), [-(2**23), -1, 0, 1, 2**23 - 1]]))
    reading = code * STEP * 1e3
    through_force = (reading * 55.6) / 55.6 + 0.0
    np.testing.assert_array_equal(force_codes(through_force, info), code)


def test_a_cubic_scaling_is_inverted_over_the_whole_range() -> None:
    info = force_info(CUBIC, "V")
    code = np.arange(-(2**15), 2**15)
    np.testing.assert_array_equal(force_codes(np.polynomial.Polynomial(CUBIC)(code), info), code)


def test_what_is_no_whole_code_has_none() -> None:
    info = force_info((0.0, STEP), "mV/V")
    reading = np.array([10.5, 11.0, np.nan, np.inf, 12.1, 1e30]) * STEP * 1e3
    np.testing.assert_array_equal(force_codes(reading, info), [NO_CODE, 11, NO_CODE, NO_CODE, NO_CODE, NO_CODE])
    for useless in ((), (1.0,), (0.0, 0.0)):
        assert (force_codes(reading, force_info(useless, "V")) == NO_CODE).all()


def test_the_file_holds_the_codes_and_a_trial_without_scaling_has_none(tmp_path) -> None:
    code = np.arange(-100, 100)
    info = force_info((0.0, STEP), "mV/V")
    write_trial(tmp_path / "a.h5", trial(200, force_raw=code * STEP * 1e3, force_info=info))
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["daq/force_code"][()], code)
        assert file["daq/force_code"].attrs["no_code"] == NO_CODE
    assert read_trial(tmp_path / "a.h5").force_info.device_scaling == (0.0, STEP)
    write_trial(tmp_path / "b.h5", trial(200))
    with h5py.File(tmp_path / "b.h5") as file:
        assert "force_code" not in file["daq"]
    assert read_trial(tmp_path / "b.h5").force_info.device_scaling == ()


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
def test_the_digest_is_that_of_what_is_read_back(name, record_steps) -> None:
    further = READBACK.replace("wire", "Drähtchen") if name == "pcie6363" else ""
    rig = parse_rig(load_rig(name).text + further, "lab.toml")
    session = record_steps(rig)
    assert_digest(session.trials[0].path)
    with h5py.File(session.trials[0].path) as file:
        assert ("motor_readback" in file["daq"]) == (name == "pcie6363") and "camera" in file
