"""Trial files: what is written is read back, sealed, and open to netCDF tools."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rig.errors import InputError
from rig.session import CameraInfo, EncoderInfo, ForceInfo, TrialData
from rig.session.sealed_hdf5 import MARK
from rig.session.trial_file import read_status, read_trial, write_trial

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
        force_n=0.5 * k,
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
        force_n=data.draw(arrays(np.float64, n, elements=finite)),
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
    np.testing.assert_allclose(data.angle_rad(), expected, atol=1e-15)


def reseal(path: Path, *, honestly: bool) -> None:
    """Put the seal back at the end, with the digest it had, or with the right one."""
    body, _, old = path.read_bytes().rpartition(MARK)
    digest = hashlib.sha256(body).hexdigest().encode() if honestly else old[:64]
    path.write_bytes(body + MARK + digest + b"\n")


def test_a_changed_sample_attribute_or_missing_seal_is_refused(tmp_path) -> None:
    for name, change in {
        "sample": lambda f: f["daq/force"].__setitem__(3, 99.0),
        "attribute": lambda f: f["daq/force"].attrs.__setitem__("group_delay_s", 0.0),
        "status": lambda f: f["daq"].attrs.__setitem__("status", "complete "),
        "extra": lambda f: f.create_dataset("daq/more", data=[1.0]),
        "seal": lambda f: f.attrs.__delitem__("sha256"),
        "schema": lambda f: f.attrs.__setitem__("schema", "other"),
    }.items():
        path = tmp_path / f"{name}.h5"
        write_trial(path, trial())
        with h5py.File(path, "r+") as file:
            change(file)
        reseal(path, honestly=name == "schema")
        with pytest.raises(InputError) as refusal:
            read_trial(path)
        assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_truncated_an_empty_and_a_missing_file_are_refused(tmp_path) -> None:
    path = tmp_path / "t.h5"
    write_trial(path, trial())
    whole = path.read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 100):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError):
            read_trial(path)
    with pytest.raises(InputError):
        read_trial(tmp_path / "none.h5")


def test_no_changed_byte_reaches_the_hdf5_library(tmp_path) -> None:
    """The library crashes the process on some of these files."""
    path = tmp_path / "t.h5"
    write_trial(path, trial(20))
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


def test_reading_a_session_loads_neither_the_ni_client_nor_numba_nor_pandas() -> None:
    heavy = ("nidaqmx", "grpc", "numba", "pandas", "scipy", "model")
    code = f"import sys, rig.session; print([m for m in {heavy} if m in sys.modules])"
    root = Path(__file__).parents[3]
    found = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
