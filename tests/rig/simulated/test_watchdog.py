"""Watchdog timers of the virtual device: the outputs they reach, their timeouts, and writes after an expiration."""

from __future__ import annotations

from typing import Any

import pytest
from nidaqmx.constants import AcquisitionType, Level, TaskMode, WatchdogAOExpirState
from nidaqmx.system import Device
from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState, WatchdogTask

from rig.simulated import daqmx


def watchdog_task(bench: Any, device: str, timeout_s: float = 0.5, name: str = "dog") -> Any:
    task = WatchdogTask(device, name, timeout_s, grpc_options=bench.options(name))
    bench.tasks.append(task)
    return task


def test_the_watchdog_reaches_what_the_product_lets_it_reach(cdaq, card, refused) -> None:
    for bench, device, ao, line in (
        (cdaq, "cDAQ1", "cDAQ1Mod2/ao0", "cDAQ1Mod4/port0/line7"),
        (card, "Dev1", "Dev1/ao0", "Dev1/port0/line0"),
    ):
        task = watchdog_task(bench, device)
        task.cfg_watchdog_do_expir_states([DOExpirationState(line, Level.LOW)])
        assert bench.device.watchdogs["dog"].levels == {line: daqmx.LOW} and Level.LOW.value == daqmx.LOW
        states = [AOExpirationState(ao, 0.0, WatchdogAOExpirState.VOLTAGE)]
        if bench is card:
            with refused(-200662):
                task.cfg_watchdog_ao_expir_states(states)
        else:
            task.cfg_watchdog_ao_expir_states(states)
        bench.device.output_v[ao], bench.device.lines[line] = 3.0, True
        task.start()
        bench.device.bench.clock.advance(0.4)
        task.reset_timer()
        bench.device.bench.clock.advance(0.4)
        assert not task.expired and bench.device.output_v[ao] == 3.0
        bench.device.bench.clock.advance(0.11)
        assert task.expired and bench.device.lines[line] is False
        assert bench.device.output_v[ao] == (3.0 if bench is card else 0.0)
        if bench is card:
            with refused(-200644):
                task.reset_timer()
            task.clear_expiration()
            assert not task.expired
    with refused(-200668):
        watchdog_task(card, "Dev1", 35.0, "long")
    watchdog_task(cdaq, "cDAQ1", 100.0, "long")
    with refused(-200668):
        watchdog_task(cdaq, "cDAQ1", 108.0, "longer")


def test_after_an_expiration_a_network_chassis_does_nothing_until_it_is_reset(cdaq, bridge, encoder, refused) -> None:
    dog, force, counts, line = watchdog_task(cdaq, "cDAQ1"), cdaq.task("f"), cdaq.task("c"), cdaq.task("l")
    bridge(force)
    force.timing.cfg_samp_clk_timing(5000.0, sample_mode=AcquisitionType.CONTINUOUS)
    encoder(counts)
    line.do_channels.add_do_chan("cDAQ1Mod4/port0/line0")  # one that the watchdog does not hold
    dog.start()
    force.start()
    with refused(-201478):  # it expires while the read waits
        force.read(5000, timeout=2.0)
    assert cdaq.device.bench.clock.now_s == pytest.approx(0.5, abs=0.03)
    assert dog.expired
    for refuse in (
        dog.reset_timer, dog.clear_expiration, force.is_task_done, lambda: force.read(1), lambda: counts.read(),
        lambda: line.write(True, auto_start=True), lambda: counts.control(TaskMode.TASK_RESERVE), counts.start,
    ):  # fmt: skip
        with refused(-201478):
            refuse()
    dog.close()
    with refused(-201478):  # clearing the task does not help either
        line.write(True, auto_start=True)
    Device("cDAQ1", grpc_options=cdaq.options()).reset_device()
    cdaq.tasks.clear()  # the reset has ended them all
    fresh = cdaq.task("fresh")
    fresh.do_channels.add_do_chan("cDAQ1Mod4/port0/line0")
    fresh.write(True, auto_start=True)
    assert cdaq.device.lines["cDAQ1Mod4/port0/line0"]


def test_after_an_expiration_an_x_series_card_goes_on_but_for_the_lines_it_holds(card, refused) -> None:
    dog, volts, out, line, other = (
        watchdog_task(card, "Dev1"), card.task("v"), card.task("o"), card.task("l"), card.task("other"),
    )  # fmt: skip
    dog.cfg_watchdog_do_expir_states([DOExpirationState("Dev1/port0/line0", Level.LOW)])
    volts.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    volts.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    out.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    line.do_channels.add_do_chan("Dev1/port0/line0")
    other.do_channels.add_do_chan("Dev1/port0/line1")
    dog.start()
    volts.start()
    assert len(volts.read(1000, timeout=2.0)) == 1000 and dog.expired  # 1 s: it has expired half way
    out.write(1.0, auto_start=True)  # X Series manual: the analog outputs are not the watchdog's
    other.write(True, auto_start=True)
    with refused(-200678):
        line.write(True, auto_start=True)
    dog.clear_expiration()
    assert card.device.lines["Dev1/port0/line0"] is False  # until it is written
    line.write(True, auto_start=True)
    assert card.device.lines["Dev1/port0/line0"] is True


def test_a_watchdog_of_a_chassis_starts_before_any_other_task_has_reserved(cdaq, refused) -> None:
    other = cdaq.task("other")
    other.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    other.start()
    task = watchdog_task(cdaq, "cDAQ1")
    task.cfg_watchdog_ao_expir_states([AOExpirationState("cDAQ1Mod2/ao0", 0.0, WatchdogAOExpirState.VOLTAGE)])
    with refused(-201477):
        task.start()
    other.stop()
    task.start()
    cdaq.device.bench.clock.advance(0.6)
    with refused(-201478):
        other.write(1.0, auto_start=True)
