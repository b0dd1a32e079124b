"""Rig files: the built-in ones are consistent with the bench; every bad value is refused with key, value and range.

TOML written is TOML read back; what does not fit is told in one line.
"""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig import InputError, RigConfig, RoomInfo, load_rig, parse_rig
from rig.configuration.rig_file import FOLDER
from rig.configuration.toml_file import built_in, check, dump_toml


def test_built_in_rig_files_load_and_declare_the_encoders_of_the_thesis() -> None:
    assert built_in(FOLDER) == ("chassis_and_card", "key_lift", "pcie6363", "thesis", "virtual")
    for name in built_in(FOLDER):
        config = load_rig(name).config
        assert config.device.sample_rate_hz == 5000
        assert {e.counts_per_revolution for e in config.encoders} == {163_840, 327_680}
        assert [e.pulses_per_revolution * 4 for e in config.encoders] == [
            e.counts_per_revolution for e in config.encoders
        ]


def test_the_9237_delays_by_40_03_samples_at_5_khz_and_a_voltage_input_does_not() -> None:
    assert load_rig("virtual").config.force.group_delay(5000) * 5000 == pytest.approx(40 + 5 / 512 + 0.0225, abs=1e-9)
    assert load_rig("pcie6363").config.force.group_delay(5000) == 0.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sample_rate_hz = 5000.0", "sample_rate_hz = nan", "device.sample_rate_hz = nan"),
        (
            "sample_rate_hz = 5000.0",
            "sample_rate_hz = -5",
            "device.sample_rate_hz = -5: input should be greater than or equal to 100",
        ),
        ("sample_rate_hz = 5000.0", "", "device.sample_rate_hz is missing"),
        (
            "counts_per_revolution = 163840",
            "counts_per_revolution = 163841",
            "encoders[2].counts_per_revolution = 163841",
        ),
        ("force_limit_n = 120.0", "force_limit_n = 121", "motor.force_limit_n = 121"),
        ("voltage_limit_v = 10.0", "voltage_limit_v = 5.0", "motor.force_limit_n = 120 N, allowed at most 60 N"),
        ("electrical = [0.0, 2.0]", "electrical = [2.0, 2.0]", "two calibration points"),
        ('product = "cDAQ-9189"', 'product = "USB-6001"', "device.product = 'USB-6001'"),
        ("[camera]", "[camero]", "unknown key camero"),
        (
            "[force]",
            "[force]\ncustom_scale = 'N'",
            "scales of NI MAX are not used; give the slope as electrical",
        ),
        ('name = "key"', 'name = "hammer"', "allowed ('key', 'whippen', 'hammer')"),
        ("cDAQ1Mod4/ctr3", "cDAQ1Mod4/ctr0", "one task per counter"),
        ("/cDAQ1Mod3/PFI5", "/cDAQ1Mod3/PFI4", "terminals"),
        (
            "exposure_s = 1.0e-4",
            "exposure_s = 1.0e-3",
            "camera.exposure_s = 0.001 s, allowed at most one frame period, 0.0005 s",
        ),
        ("quiet_s = 0.35", "quiet_s = 0.1", "recording.quiet_s = 0.1"),
        ("rest_s = 0.2", "rest_s = 0.0", "recording.rest_s = 0.0"),
        ("sample_rate_hz = 5000.0", "sample_rate_hz = true", "device.sample_rate_hz = True"),
        ("sample_rate_hz = 5000.0", 'sample_rate_hz = "5000"', "device.sample_rate_hz = '5000'"),
        ("electrical = [0.0, 2.0]", "electrical = [0.0, 2.0, 3.0]", "force.electrical"),
        ("u_noise_n = 0.02", 'u_noise_n = "0.02 N"', "force.u_noise_n = '0.02 N'"),
        ('date = "2026-01-15", u_relative = 0.003', 'date = "15.1.2026", u_relative = 0.003', "force.certificate.date"),
        ("u_pivot_shift_rad = 2.0e-6", "u_pivot_shift_rad = -1.0", "encoders[0].u_pivot_shift_rad"),
        ("free_travel_rad = 0.3", "free_travel_rad = 0.0", "arm.free_travel_rad"),
        ("allow_yes = false", 'allow_yes = "yes"', "safety.allow_yes"),
        ('mode = "pulses"', 'mode = "free"', "camera.mode"),
        ("stroke_rad = [-0.043, 0.082, -0.357]", "stroke_rad = [-0.043, 0.082]", "selftest.stroke_rad"),
        ("[selftest]", "[selftest]\npush_tolerance = 0.51", "selftest.push_tolerance = 0.51"),
    ],
)
def test_a_bad_value_is_refused_with_its_key_and_what_is_allowed(rig, old, new, said) -> None:
    assert old in rig.text
    with pytest.raises(InputError) as refusal:
        parse_rig(rig.text.replace(old, new), "bad.toml")
    message = str(refusal.value)
    assert message.startswith("bad.toml: ") and said in message and "\n" not in message


def test_a_missing_rig_file_is_refused() -> None:
    with pytest.raises(InputError, match="built in are chassis_and_card, key_lift, pcie6363, thesis, virtual"):
        load_rig("nowhere.toml")


def test_both_examples_are_complete_and_their_certificates_and_budgets_reach_the_trial(record_steps) -> None:
    for name, product in (("virtual", "cDAQ-9189"), ("pcie6363", "PCIe-6363")):
        rig = load_rig(name)
        config = rig.config
        assert config.device.product == product and config.selftest is not None and config.arm is not None
        assert config.drive_enable and config.watchdog and config.camera and config.limits.least_preload_n
        data = record_steps(rig, name).trial(1).read()
        assert "maker's data sheet, 2026-01-15, u = 0.003 relative" in data.force_info.calibration
        for encoder, written in zip(config.encoders, data.encoders, strict=True):
            assert "2026-01-15" in written.calibration
            assert written.u_turn_relative**2 == pytest.approx(
                encoder.u_scale_relative**2 + encoder.u_eccentricity_rad**2
            )
            assert written.u_change_rad**2 == pytest.approx(
                2 * encoder.u_interpolation_rad**2 + encoder.u_pivot_shift_rad**2
            )


scalars = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.text(st.characters(exclude_categories=("Cs",))),
)
keys = st.text(st.characters(exclude_categories=("Cs",)), max_size=8)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(keys, inner, max_size=4)),
    max_leaves=12,
)


@given(st.dictionaries(keys, values, max_size=5))
def test_any_table_survives_a_round_trip(table) -> None:
    assert tomllib.loads(dump_toml(table)) == table


def test_none_is_left_out_and_nan_kept() -> None:
    read = tomllib.loads(dump_toml({"a": None, "b": math.nan}))
    assert set(read) == {"b"} and math.isnan(read["b"])
    assert tomllib.loads(dump_toml({"c": np.float64(21.5), "d": -np.inf})) == {"c": 21.5, "d": -math.inf}


@pytest.mark.parametrize("value", [float("nan"), "warm", -300.0, 61.0, True])
def test_a_value_of_several_kinds_is_told_in_one_line_with_all_of_them(value: object) -> None:
    with pytest.raises(InputError) as caught:
        check(RoomInfo, {"temperature_c": value}, "a.toml")
    said = str(caught.value)
    assert said.startswith(f"a.toml: temperature_c = {value!r}: input should be")
    assert said.endswith(" or input should be 'unknown'")
    assert check(RoomInfo, {"temperature_c": "unknown"}, "a.toml").temperature_c == "unknown"


def test_a_misspelt_key_is_named_before_the_one_it_leaves_missing() -> None:
    with pytest.raises(InputError, match=r"unknown key devic = 1; .* device is missing"):
        check(RigConfig, {"devic": 1}, "a.toml")
