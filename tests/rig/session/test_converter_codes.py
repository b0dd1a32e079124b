"""Codes of the converter: exactly what was converted, or nothing."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np

from rig.session import ForceInfo
from rig.session.trial_file import NO_CODE, force_codes, read_trial, write_trial
from tests.rig.session.test_trial_file import FORCE, trial

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


def test_provenance_comes_back_and_is_sealed(tmp_path) -> None:
    said = {"operator": "Ana Müller", "serial_number": "01AB23CD"}
    write_trial(tmp_path / "a.h5", trial(5, provenance=said))
    write_trial(tmp_path / "b.h5", trial(5, provenance={**said, "operator": "Bea"}))
    a, b = (read_trial(tmp_path / f"{name}.h5") for name in "ab")
    assert a.provenance == said and a.sha256 != b.sha256
