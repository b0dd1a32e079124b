"""Rig files: the built-in ones are consistent with the bench; every bad value is refused with key, value and range."""

from __future__ import annotations

import pytest

from rig.config import built_in_rigs, load_rig, parse_rig
from rig.errors import InputError


def test_built_in_rig_files_load_and_declare_the_encoders_of_the_thesis() -> None:
    assert built_in_rigs() == ("pcie6363", "virtual")
    for name in built_in_rigs():
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
    ],
)
def test_a_bad_value_is_refused_with_its_key_and_what_is_allowed(rig, old, new, said) -> None:
    assert old in rig.text
    with pytest.raises(InputError) as refusal:
        parse_rig(rig.text.replace(old, new), "bad.toml")
    message = str(refusal.value)
    assert message.startswith("bad.toml: ") and said in message and "\n" not in message


def test_a_missing_rig_file_is_refused() -> None:
    with pytest.raises(InputError, match="built in are pcie6363, virtual"):
        load_rig("nowhere.toml")
