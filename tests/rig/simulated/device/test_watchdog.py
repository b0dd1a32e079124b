"""Watchdog timers of the virtual device: the outputs they reach, their timeouts, and writes after an expiration."""

from __future__ import annotations

from typing import Any

from rig.simulated import daqmx


def watchdog_task(bench: Any, device: str, timeout_s: float = 0.5, name: str = "dog") -> Any:
    from nidaqmx import GrpcSessionOptions
    from nidaqmx.system.watchdog import WatchdogTask

    task = WatchdogTask(device, name, timeout_s, grpc_options=GrpcSessionOptions(bench._channel, name))
    bench._tasks.append(task)
    return task


def test_the_watchdog_reaches_what_the_product_lets_it_reach(cdaq, card, refused) -> None:
    from nidaqmx.constants import Level, WatchdogAOExpirState
    from nidaqmx.system.watchdog import AOExpirationState, DOExpirationState

    for bench, device, ao, line in (
        (cdaq, "cDAQ1", "cDAQ1Mod2/ao0", "cDAQ1Mod4/port0/line7"),
        (card, "Dev1", "Dev1/ao0", "Dev1/port0/line0"),
    ):
        task = watchdog_task(bench, device)
        task.cfg_watchdog_do_expir_states([DOExpirationState(line, Level.LOW)])
        assert bench.device.watchdogs["dog"].lines == {line: False} and Level.LOW.value == daqmx.LOW
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
        with refused(-200644):
            task.reset_timer()
        task.clear_expiration()
        assert not task.expired
    with refused(-200668):
        watchdog_task(cdaq, "cDAQ1", 100.0, "long")


def test_outputs_cannot_be_written_while_an_expired_watchdog_holds_them(cdaq, refused) -> None:
    from nidaqmx.constants import WatchdogAOExpirState
    from nidaqmx.system.watchdog import AOExpirationState

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
    with refused(-200678):
        other.write(1.0, auto_start=True)
    task.clear_expiration()
    other.write(1.0, auto_start=True)
    assert cdaq.device.output_v["cDAQ1Mod2/ao0"] == 1.0
