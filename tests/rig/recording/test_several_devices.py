"""A session over several cards: one clock, told apart from two; a missing cable or wire is named."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.simulated.backend import DEFAULT_BENCH

STEP = Path(__file__).parents[1] / "step.toml"


def planted(folder: Path, wiring: str) -> str:
    bench = folder / "bench.toml"
    bench.write_text(f"{DEFAULT_BENCH.read_text('utf-8')}\n[wiring]\n{wiring}\n", encoding="utf-8")
    return f"sim://?bench={bench.as_posix()}"


@pytest.mark.parametrize("name", ["thesis", "chassis_and_card"])
def test_a_session_over_several_cards_is_that_of_one(tmp_path: Path, name: str) -> None:
    alone = rig.record(tmp_path / "one", profile="forte", trials=1).trial(1).read()
    trial = rig.record(tmp_path / "several", profile="forte", trials=1, rig_config=name).trial(1)
    several = trial.read()
    assert trial.status == "complete" and several.sample_rate_hz == alone.sample_rate_hz
    n = min(alone.n_valid, several.n_valid) - 60
    np.testing.assert_allclose(several.encoder_count[:n], alone.encoder_count[:n], atol=2)
    felt = []
    for data in (alone, several):  # each at the time it was felt, 8 ms and 0.04 ms before its sample
        at = data.time_s[:n] + data.force_info.group_delay_s
        felt.append(np.interp(at, data.time_s, data.force_n))
    noise = 8 * 0.02 + 0.06  # of both cells, the hum between them, the converter's step
    assert np.abs(felt[0] - felt[1])[200:].max() < noise + 0.02 * alone.force_n.max()


def test_a_cable_that_is_not_registered_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(rig.HardwareFault, match=r"no RTSI cable joins the devices.* -89125"):
        rig.record(tmp_path / "s", profile=STEP, rig_config="thesis", backend=planted(tmp_path, "rtsi = false"))
    assert not (tmp_path / "s").exists()


def test_a_wire_that_is_missing_is_found_by_the_encoder_that_gives_no_samples(tmp_path: Path) -> None:
    address = planted(tmp_path, "wires = false")
    with pytest.raises(rig.ReadTimeout, match="encoder_key"):
        rig.record(tmp_path / "s", profile=STEP, rig_config="chassis_and_card", backend=address)


def test_another_card_in_the_slot_is_refused_by_name(tmp_path: Path) -> None:
    thesis = rig.load_rig("thesis")
    other = rig.parse_rig(thesis.text.replace('product = "PCI-6602"', 'product = "PCIe-6363"'))
    bench = rig.open_backend("sim://", thesis.config)
    with pytest.raises(rig.RigInputError, match=r"product = 'PCIe-6363': device Dev2 is a PCI-6602"):
        bench.identify(other.config)  # type: ignore[attr-defined]
    bench.close()


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("thesis", 'link = "RTSI"', 'link = "own"', "devices[0].link = 'own'"),
        ("thesis", 'name = "Dev3"', 'name = "Dev2"', "each needs a name of its own"),
        ("thesis", 'link = "RTSI"', 'link = "lines"', "needs clock_from and clock_to, the ends of the wire"),
        ("thesis", 'channel = "SC1Mod1/ai0"', 'channel = "Dev3/ai0"', "force and further channels give the clock"),
        ("thesis", 'counter = "Dev1/ctr0"', 'counter = "Dev2/ctr4"', "run on its own timebase"),
        ("chassis_and_card", 'clock_to = "/Dev1/PFI5"', 'clock_to = "/Dev2/PFI5"', "allowed a terminal of Dev1"),
        ("chassis_and_card", 'clock_from = "/cDAQ1Mod4/PFI5"', 'clock_from = "/Dev1/PFI6"', "a terminal of cDAQ1"),
        ("chassis_and_card", 'line = "cDAQ1Mod4/port0/line7"', 'line = "Dev1/port0/line0"', "whose watchdog it is"),
    ],
)
def test_a_rig_file_whose_devices_cannot_work_together_is_refused(name: str, old: str, new: str, said: str) -> None:
    text = rig.load_rig(name).text
    assert old in text
    with pytest.raises(rig.RigInputError, match=re.escape(said)):
        rig.parse_rig(text.replace(old, new))
