"""Devices are found, not assumed: with serial numbers, over a server, and as a rig file for what is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rig import HardwareFault, InputError, load_rig, open_backend, parse_rig
from rig.daq.address import discover
from rig.daq.discovery import FoundDevice
from rig.daq.rig_proposal import propose_rig
from tests.command_line import run

CHASSIS = FoundDevice(
    "cDAQ9189-01AB",
    "cDAQ-9189",
    0x01AB23CD,
    False,
    modules=(
        FoundDevice("amplifier", "NI 9401", 0x11, False, 1),
        FoundDevice("cDAQ1Mod1", "NI 9263", 0x22, False, 2),
        FoundDevice("cDAQ9189-01ABMod3", "NI 9237", 0x33, False, 3),
        FoundDevice("cDAQ9189-01ABMod5", "NI 9411", 0x44, False, 5),
    ),
)


@pytest.mark.parametrize("rig", ["virtual", "pcie6363"])
def test_what_a_server_has_is_listed_without_a_rig_file(rig, served) -> None:
    backend = open_backend("sim://", load_rig(rig).config)
    server, address = served(backend)
    driver, devices = discover(address)
    server.stop(None).wait()
    assert driver.count(".") == 2 and devices == backend.devices()
    (device,) = devices
    assert device.product == load_rig(rig).config.device.product and device.serial == "none (simulated)"
    assert [module.slot for module in device.modules] == ([1, 2, 3, 4] if rig == "virtual" else [])
    with pytest.raises(HardwareFault, match="does not answer"):
        discover(address)
    with pytest.raises(InputError, match="allowed are ni://local"):
        discover("usb://1")


def test_a_proposal_has_the_names_found_and_their_serial_numbers() -> None:
    text = propose_rig([replace(CHASSIS, name="other", product="USB-6001", modules=()), CHASSIS])
    config = parse_rig(text).config
    assert config.device.name == "cDAQ9189-01AB" and config.name == "cdaq9189_01ab"
    assert config.force.channel == "cDAQ9189-01ABMod3/ai0" and config.motor.channel == "cDAQ1Mod1/ao0"
    assert config.encoders[0].a_terminal == "/cDAQ9189-01ABMod5/PFI0"
    assert config.drive_enable is not None and config.drive_enable.line == "amplifier/port0/line7"
    for serial in ("01AB23CD", "00000011", "00000022", "00000033", "00000044"):
        assert serial in text
    card = parse_rig(propose_rig([FoundDevice("X", "PCIe-6363", 5, False)])).config
    assert card.device.name == "X" and card.force.channel == "X/ai0" and card.encoders[2].b_terminal == "/X/PFI1"


def test_what_cannot_be_proposed_is_refused_with_what_is_there() -> None:
    with pytest.raises(InputError, match=r"devices found: none; .* cDAQ-9189 or PCIe-6363"):
        propose_rig([])
    with pytest.raises(InputError, match=r"cDAQ9189-01AB \(cDAQ-9189\); .* named Dev7"):
        propose_rig([CHASSIS], "Dev7")
    with pytest.raises(InputError, match=r"has no NI 9237 \(load cell\); found are NI 9401 in slot 1, NI 9263"):
        propose_rig([replace(CHASSIS, modules=CHASSIS.modules[:2])])


def test_the_command_lists_modules_and_writes_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", "--backend", "sim://") == 0
    assert "device cDAQ1Mod1  product NI 9237  serial_number none (simulated)  slot 1" in capsys.readouterr().out
    out = tmp_path / "my.toml"
    assert run("info", "--backend", "sim://", "--propose", out) == 0
    assert load_rig(out).config.device == load_rig("virtual").config.device
    assert run("info", "--backend", "sim://", "--propose", out) == 2
    assert "exists already" in capsys.readouterr().err
    assert run("info", "--propose", tmp_path / "b.toml") == 2
