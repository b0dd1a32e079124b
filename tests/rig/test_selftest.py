"""The edge of a push is found to a tenth of a millisecond, however the arm rings, with an uncertainty that covers.

The self-test passes on a sound bench and names every planted wiring fault; recording demands its record.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from pianorig.cli import main
from pianorig.commands.selftest import check_bench
from rig import InputError, NotPermitted, load_rig, run_selftest
from rig.selftest import fit_edge, push_response, push_train, read_record, subtract_hum

RATE = 5000.0
AT = 10.03


def response(
    hz: float, damping: float, late_s: float, random: np.random.Generator, noise_n: float = 0.007
) -> np.ndarray:
    t = np.maximum((np.arange(750) - AT) / RATE - late_s, 0.0)
    w = 2 * np.pi * hz
    wd, decay = w * np.sqrt(1 - damping**2), w * damping
    force = 0.25 * (1 - np.exp(-decay * t) * (np.cos(wd * t) + decay / wd * np.sin(wd * t)))
    return force + noise_n * random.standard_normal(t.size)


@pytest.mark.parametrize(("hz", "damping"), [(560, 0.05), (200, 0.2), (1000, 0.1), (1800, 0.5), (120, 0.1)])
@pytest.mark.parametrize("late_s", [-1e-4, 0.0, 3e-4, 8e-3])
def test_a_delay_is_found_within_a_tenth_of_a_millisecond(hz, damping, late_s) -> None:
    random = np.random.default_rng([int(hz), int(1e6 * (late_s + 1))])
    edge = fit_edge(response(hz, damping, late_s, random), RATE, AT)
    assert edge is not None and abs(edge.late_s - late_s) < 1e-4
    assert abs(edge.late_s - late_s) < 4 * edge.u_s + 5e-6


def test_without_a_push_there_is_no_edge() -> None:
    random = np.random.default_rng(1)
    assert fit_edge(-response(560, 0.05, 0.0, random), RATE, AT) is None
    assert fit_edge(np.full(750, np.nan), RATE, AT) is None


def test_hum_that_repeats_with_the_pushes_is_taken_off() -> None:
    volts = push_train(0.02, RATE)
    t = np.arange(volts.size) / RATE
    hum = 0.05 * np.sin(2 * np.pi * 60 * t + 0.3) + 0.02 * np.cos(2 * np.pi * 180 * t)
    mean, plateau = push_response(subtract_hum(12 * volts + 0.2 + hum, RATE, 60.0, 0), RATE, 0)
    assert plateau == pytest.approx(0.24, abs=1e-3) and np.abs(mean[5:700] - 0.24).max() < 5e-3


STROKES = ("stroke_rad = [-0.043, 0.082, -0.357]", "stroke_rad = [-0.01042, 0.004167, 0.0625]")
"""What the algebraic bench does under the hand's 2.5 N."""
LONG_BLOCKS = ("block_s = 0.02", "block_s = 0.1")
"""Nothing here reacts within a trial: a fifth of the calls say the same."""
SWAPPED = (("PFI0", "PFI9"), ("PFI2", "PFI0"), ("PFI9", "PFI2"), ("PFI1", "PFI9"), ("PFI3", "PFI1"), ("PFI9", "PFI3"))


@pytest.fixture
def run(make_backend, edited_rig):
    """Self-test of the algebraic bench under an edited rig file: (record, backend)."""

    def call(*edits: tuple[str, str], change=lambda device: None, **force):
        sound = load_rig("virtual")
        rig = edited_rig(STROKES, LONG_BLOCKS, *edits)
        backend = make_backend(sound.config, noise_n=0.02, offset_n=0.15, **force)
        backend.device.bench.operator_acts = True
        change(backend.device)
        prompts = []
        record = run_selftest(rig, backend, prompt=prompts.append)
        assert len(prompts) == 1 and "lift the arm" in prompts[0]
        return record, backend

    return call


def failed(record) -> dict[str, str]:
    return {finding.check: finding.advice for finding in record.findings if not finding.passed}


def test_a_sound_bench_passes_every_check_and_is_left_safe(run, assert_safe) -> None:
    record, backend = run()
    assert failed(record) == {} and record.passed
    found = {finding.check: finding.found for finding in record.findings}
    assert list(found) == [
        "unloaded reading", "preload", "load cell by hand", "key encoder", "whippen encoder", "hammer encoder",
        "counts below zero", "drive disabled", "motor and force", "output to force delay", "watchdog trips",
        "watchdog cuts the force", "bridge shunt", "camera count",
    ]  # fmt: skip
    assert record.unloaded_n == pytest.approx(0.15, abs=0.002)
    # force follows the command within one sample, felt 40.03 samples after that
    assert float(found["output to force delay"].split()[0]) == pytest.approx(0.0, abs=0.1)  # ms
    assert float(found["bridge shunt"].split()[0]) == pytest.approx(1e3 * 350 / (4 * 100e3 + 2 * 350), rel=1e-3)
    assert_safe(backend)


@pytest.mark.parametrize(
    ("edits", "checks", "said"),
    [
        (SWAPPED, {"key encoder", "whippen encoder"}, "reads like the whippen"),
        ((("sign = -1", "sign = 1"),), {"hammer encoder"}, "wrong way"),
        ((("counts_per_revolution = 163840", "counts_per_revolution = 327680"),), {"hammer encoder"}, "scale by 0.5"),
        ((("Mod3/PFI4", "Mod4/PFI6"), ("Mod3/PFI5", "Mod4/PFI7")), {"hammer encoder"}, "does not move"),
        (
            (("Mod1/ai0", "Mod1/ai2"),),
            {"preload", "load cell by hand", "motor and force", "output to force delay", "watchdog cuts the force",
             "bridge shunt"},
            "swapped",
        ),
        (
            (("port0/line7", "port0/line6"),),
            {"motor and force", "output to force delay", "watchdog cuts the force"},
            "line6 does not enable the drive",
        ),
        (
            (("Mod2/ao0", "Mod2/ao3"),),
            {"motor and force", "output to force delay", "watchdog cuts the force"},
            "Mod2/ao3 is not the motor",
        ),
        ((("force_per_volt_n = 12.0", "force_per_volt_n = 24.0"),), {"motor and force"}, "force_per_volt_n"),
        (
            (("physical_n = [0.0, 111.2]", "physical_n = [0.0, -111.2]"),),
            {"load cell by hand", "motor and force", "output to force delay", "watchdog cuts the force"},
            "reads a push as a pull",
        ),
        ((("counts_per_revolution = 163840", "counts_per_revolution = 40960"),), {"hammer encoder"}, "all four edges"),
        ((("u_group_delay_s = 2.0e-5", "u_group_delay_s = 2.0e-5\ngroup_delay_s = 0.0"),), {"output to force delay"},
         "group_delay_s"),
        ((('mode = "pulses"', 'mode = "counted"'), ("Mod4/PFI4", "Mod4/PFI5")), {"camera count"}, "Mod4/PFI5"),
        (
            (("bridge_resistance_ohm = 350.0", "bridge_resistance_ohm = 1000.0"),),
            {"bridge shunt"}, "bridge_resistance",
        ),
    ],
)  # fmt: skip
def test_each_wiring_fault_is_found_and_named(edits, checks, said, run, assert_safe) -> None:
    record, backend = run(*edits)
    found = failed(record)
    assert set(found) == checks and not record.passed
    assert any(said in advice for advice in found.values()), found
    assert not any(backend.device.output_v.values()) and not backend.device.drive_enabled()


def test_a_drive_that_ignores_its_enable_line_is_found(run) -> None:
    from dataclasses import replace

    def bridge(device) -> None:
        device.wiring = replace(device.wiring, drive_enable=None)

    record, _ = run(change=bridge)
    assert "drive disabled" in failed(record) and "bridged" in failed(record)["drive disabled"]


def test_a_watchdog_that_does_not_run_is_found(run) -> None:
    class Endless(dict):
        def __setitem__(self, name, timer) -> None:
            timer.timeout_s = float("inf")
            super().__setitem__(name, timer)

    def dead(device) -> None:
        device.watchdogs = Endless()

    record, _ = run(change=dead)
    assert {"watchdog trips", "watchdog cuts the force"} == set(failed(record))


def test_a_fault_of_the_hardware_is_a_finding_and_the_test_goes_on(run, assert_safe) -> None:
    from rig.simulated.device.faults import parse_faults
    from rig.simulated.device.state import FaultPlan

    def plant(device) -> None:
        device.faults = FaultPlan(parse_faults("overwrite@2/0.5"))

    record, backend = run(change=plant)
    assert set(failed(record)) == {"drive disabled"}
    assert "overwritten" in next(f.found for f in record.findings if not f.passed)
    assert_safe(backend)


@pytest.fixture
def long_blocks(tmp_path):
    """Path of a built-in rig file with long blocks."""

    def write(name: str) -> str:
        path = tmp_path / f"{name}.toml"
        path.write_text(load_rig(name).text.replace(*LONG_BLOCKS))
        return str(path)

    return write


def test_the_command_writes_a_dated_record_and_fails_when_a_check_does(long_blocks, tmp_path, capsys) -> None:
    card = long_blocks("pcie6363")
    path, record = check_bench("sim://?hand=yes", card, tmp_path, operator="ana", ask=lambda question: None)
    assert record.passed and read_record(path) == record.model_copy(
        update={"created_utc": record.created_utc.replace(microsecond=0)}
    )
    assert record.operator == "ana" and record.rig_sha256 == load_rig(card).sha256
    assert "output to input" in {finding.check for finding in record.findings}
    assert (datetime.now(UTC) - record.created_utc).total_seconds() < 600
    with pytest.raises(SystemExit) as end:  # nobody's hand: nothing moves, nothing is lifted
        main(["selftest", "--backend", "sim://", "--rig", long_blocks("virtual"), "--out", str(tmp_path), "--json"])
    assert end.value.code == 3
    printed = json.loads(capsys.readouterr().out)
    assert {f["check"] for f in printed["findings"] if not f["passed"]} >= {"key encoder", "preload"}


def test_wiring_planted_in_the_bench_file_is_found(long_blocks, tmp_path, bench_with) -> None:
    planted = 'drive_enable = "bridged"\nkey = ["Mod3/PFI2", "Mod3/PFI3"]\nwhippen = ["Mod3/PFI1", "Mod3/PFI0"]'
    address = bench_with(planted) + "&hand=yes"
    _, record = check_bench(address, long_blocks("virtual"), tmp_path, ask=lambda question: None)
    found = failed(record)
    assert {"key encoder", "whippen encoder", "drive disabled"} <= set(found)
    assert "swapped with the whippen" in found["key encoder"] and "bridged" in found["drive disabled"]
    for bad in ("motor = 3", 'jack = ["PFI1", "PFI2"]', 'key = ["PFI1"]'):
        with pytest.raises(InputError, match="wiring.*allowed are force"):
            check_bench(bench_with(bad), "virtual", tmp_path, ask=lambda question: None)


def test_hardware_is_not_pushed_before_somebody_confirms(rig, make_backend, tmp_path, monkeypatch) -> None:
    from rig.backend import Capabilities

    backend = make_backend(rig.config)
    monkeypatch.setattr(type(backend), "capabilities", Capabilities("card", False, {}, hardware=True))
    monkeypatch.setattr("rig.open_backend", lambda url, config: backend)
    with pytest.raises(NotPermitted):
        check_bench("ni://local", "virtual", tmp_path, ask=lambda question: None)
    assert backend.service.trace == [] and list(tmp_path.iterdir()) == []


def test_a_rig_file_that_does_not_say_what_is_sound_cannot_be_tested(rig, make_backend) -> None:
    backend = make_backend(rig.config)
    bare = type(rig)(rig.config.model_copy(update={"selftest": None}), rig.text, rig.sha256, "bare.toml")
    with pytest.raises(InputError, match=r"bare.toml: has no \[selftest\]"):
        run_selftest(bare, backend, prompt=lambda text: None)
