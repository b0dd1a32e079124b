"""The backend on the real client: the same rig in process and over TCP, every channel its own, bad input refused."""

from __future__ import annotations

from typing import Any

import grpc
import numpy as np
import pytest

from rig import (
    DeviceNotFound,
    HardwareFault,
    InputError,
    NotSupported,
    ReadTimeout,
    SamplesLost,
    load_rig,
    open_backend,
    reset_server,
)
from rig.daq import NidaqmxBackend
from rig.daq.nidaqmx_backend import CallDelay, calm_block_s
from rig.simulated.signals import pulse_train
from rig.simulated.status import NotAnswered
from rig.simulated.timing import advance

RAD_PER_VOLT = np.array([-0.05, 0.02, 0.3])


def record(backend: NidaqmxBackend, config: Any, command: np.ndarray, blocks: int = 10) -> tuple[np.ndarray, ...]:
    timing = backend.configure(config, command)
    backend.arm()
    backend.start()
    read = [backend.read_block(100, 1.0) for _ in range(blocks)]
    backend.safe_stop()
    assert [block.first_sample for block in read] == list(range(0, 100 * blocks, 100))
    force, raw, count = ([getattr(b, name) for b in read] for name in ("force_n", "force_raw", "encoder_count"))
    return timing, np.concatenate(force), np.concatenate(raw), np.concatenate(count)


def expected_force(command: np.ndarray, n: int, delay_samples: float) -> np.ndarray:
    """Force of the algebraic plant: 12 N per volt held before the edge, 0.05 N at rest, read later."""
    held = np.concatenate((command, np.zeros(n)))[:n]
    felt = 0.05 + 12.0 * np.concatenate(([0.0], held[:-1]))
    return np.interp(np.arange(n) - delay_samples, np.arange(n), felt)


@pytest.mark.parametrize("name", ["virtual", "pcie6363"])
def test_each_channel_reads_its_own_sensor_with_the_delay_of_its_module(name, make_backend, command) -> None:
    config = load_rig(name).config
    timing, force, raw, count = record(make_backend(config), config, command)
    delay = (40 + 5 / 512) + 4.5e-6 * 5000 if name == "virtual" else 0.0
    assert timing.force_group_delay_s * 5000 == pytest.approx(delay)
    resolution = 111.2 / 10 * 20 / 2**16 if name == "pcie6363" else 1e-3
    np.testing.assert_allclose(force, expected_force(command, 1000, delay), atol=resolution)
    per_newton = 2.0 / 111.2 if name == "virtual" else 10.0 / 111.2
    np.testing.assert_allclose(raw, force * per_newton, atol=1e-12)
    felt = np.concatenate(([0.0], command, np.zeros(500)))[:1000]
    per_rad = np.array([327680, 327680, -163840]) / (2 * np.pi)
    assert count.dtype == np.int64
    assert np.max(np.abs(count - felt[:, None] * RAD_PER_VOLT * per_rad)) < 1.0
    assert timing.frame_rate_hz == 2000.0 and timing.first_pulse_s == pytest.approx(1e-3)


@pytest.mark.usefixtures("on_any_machine")
def test_the_same_rig_over_tcp_gives_identical_arrays(make_backend, assert_safe, config, command, served) -> None:
    near, far = (make_backend(config, noise_n=0.03, hum_n=(0.1,)) for _ in range(2))
    remote = open_backend(served(far)[1], config)
    here, there = record(near, config, command), record(remote, config, command)
    # opening asked for versions and devices, then marked the sessions; resets of the watchdog go by the clock
    near_calls, far_calls = ([c for c in b.service.trace if c != "ControlWatchdogTask"] for b in (near, far))
    assert_safe(far)
    remote.close()
    assert near_calls == far_calls[len(far_calls) - len(near_calls) :]
    assert here[0] == there[0] and here[1].std() > 0.01
    for a, b in zip(here[1:], there[1:], strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.usefixtures("on_any_machine")
def test_faults_come_through_tcp_with_their_codes(make_backend, assert_safe, unwatched, begin, served) -> None:
    far = make_backend(unwatched)
    server, address = served(far)
    remote = open_backend(address, unwatched)
    begin(remote, config=unwatched)
    with pytest.raises(ReadTimeout) as fault:
        remote.read_block(100, 0.01)
    assert (fault.value.code, fault.value.samples_read) == (-200284, 50)
    assert_safe(far)
    begin(remote, 100, unwatched)
    advance(far.device, 100_001)  # 20 s at 5 kHz is what the driver was told to keep
    with pytest.raises(SamplesLost, match="overwritten"):
        remote.read_block(100, 1.0)
    assert_safe(far)
    begin(remote, config=unwatched)
    server.stop(None).wait()
    with pytest.raises(DeviceNotFound, match="does not answer") as gone:
        remote.read_block(100, 1.0)
    assert gone.value.phase == "read"
    with pytest.raises(DeviceNotFound, match="emergency stop"):
        remote.close()
    with pytest.raises(DeviceNotFound, match="does not answer"):
        open_backend(address, unwatched)


@pytest.mark.parametrize("name", ["virtual", "pcie6363"])
def test_every_task_runs_on_the_clock_and_trigger_of_the_force_input(name, make_backend, command) -> None:
    config = load_rig(name).config
    backend = make_backend(config)
    backend.configure(config, command)
    tasks = {name: task for name, task in backend.device.tasks.items() if task.state != "unreserved"}
    assert tasks.pop("watchdog").state == "running"
    assert list(tasks) == ["force", "encoder_key", "encoder_whippen", "encoder_hammer", "motor", "camera"]
    clocks = {task: t.clock.source if t.clock else None for task, t in tasks.items()}
    slaves = ["encoder_key", "encoder_whippen", "encoder_hammer", "motor"]
    assert clocks == {"force": "", "camera": None, **dict.fromkeys(slaves, "ai/SampleClock")}
    assert [tasks[s].triggers.arm_start for s in slaves] == ["ai/StartTrigger"] * 3 + [""]
    assert tasks["camera"].triggers.start == "ai/StartTrigger"
    assert all(t.state == "committed" for t in tasks.values())
    np.testing.assert_array_equal(tasks["motor"].output.samples[:, 0], command)
    clock = tasks["motor"].clock
    assert clock.samples == command.size and clock.mode == 10178  # finite


def pulse_edges_s(device, counter: str) -> np.ndarray:
    """Rising edges a counter has generated since its trigger, s; none when it does not run."""
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and any(c.physical.name == counter for c in task.channels):
            train = pulse_train(task)
            return train.first_s + np.arange(train.passed_at(device.bench.now_s)) / train.rate_hz
    return np.empty(0)


def test_the_frame_pulses_are_where_the_backend_says(make_backend, config, command) -> None:
    camera = config.camera.model_copy(update={"frame_rate_hz": 3000.0, "start_delay_s": 0.0123})
    config = config.model_copy(update={"camera": camera})
    backend = make_backend(config)
    timing = backend.configure(config, command)
    backend.arm()
    assert pulse_edges_s(backend.device, camera.counter).size == 0
    backend.start()
    backend.read_block(500, 1.0)
    edges = pulse_edges_s(backend.device, camera.counter)
    assert edges[0] == timing.first_pulse_s == pytest.approx(0.0123, abs=1e-7)
    assert np.diff(edges) == pytest.approx(1 / timing.frame_rate_hz)
    assert edges[-1] <= 0.1 < edges[-1] + 1 / 2999
    backend.safe_stop()
    assert pulse_edges_s(backend.device, camera.counter).size == 0


def test_the_drive_is_enabled_last_and_the_output_is_zero_before_anything_is_reserved(
    make_backend, config, command
) -> None:
    backend = make_backend(config)
    backend.device.output_v["cDAQ1Mod2/ao0"] = 3.0  # another program left it there
    backend.configure(config, command)
    assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0
    assert not backend.device.drive_enabled()
    backend.arm()
    trace = backend.service.trace
    assert backend.device.drive_enabled()
    last_start = len(trace) - trace[::-1].index("StartTask") - 1
    assert "WriteDigitalLines" in trace[last_start:]


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros((4, 2)),
        np.zeros(1),
        np.array([0, np.nan, 0]),
        np.array([0, 1.0]),
        np.array([1.0, 0]),
        np.array([0, 10.5, 0]),
    ],
)
def test_a_bad_command_is_refused_before_anything_is_touched(bad, make_backend, config) -> None:
    backend = make_backend(config)
    with pytest.raises(InputError, match="motor command"):
        backend.configure(config, bad)
    assert backend.service.trace == []


def test_a_rate_the_9237_does_not_have_is_refused_with_the_one_it_has(make_backend, edited_rig) -> None:
    config = edited_rig(("sample_rate_hz = 5000.0", "sample_rate_hz = 4000.0")).config
    backend = make_backend(config)
    with pytest.raises(InputError, match="4000 Hz: NI 9237 gives 4166.67 Hz"):
        backend.configure(config, np.zeros(10))


def test_calls_out_of_order_are_faults_not_crashes(make_backend, config, command) -> None:
    backend = make_backend(config)
    for step in (backend.arm, backend.start, lambda: backend.read_block(10, 1.0)):
        with pytest.raises(HardwareFault, match="call configure first"):
            step()
    backend.configure(config, command)
    backend.safe_stop()
    backend.safe_stop()
    with pytest.raises(HardwareFault):
        backend.arm()


def test_what_the_device_does_not_have_is_not_supported(make_backend, config, command) -> None:
    backend = make_backend(config)
    reservations = backend.device.reservations
    reserve = reservations.reserve
    reservations.reserve = lambda task: (_ for _ in ()).throw(NotAnswered("commit"))
    with pytest.raises(NotSupported):
        backend.configure(config, command)
    reservations.reserve = reserve


def test_without_the_driver_or_the_device_ni_local_says_so(config) -> None:
    with pytest.raises(HardwareFault) as fault:
        open_backend("ni://local", config)
    assert fault.value.phase == "connect" and "\n" not in str(fault.value)


def test_what_answers_must_be_the_product_of_the_rig_file_and_says_whether_it_is_simulated(
    make_backend, config, served
) -> None:
    _, address = served(make_backend(config))
    remote = open_backend(address, config)
    assert remote.capabilities.simulated is True and remote.capabilities.description["product"] == "cDAQ-9189"
    remote.close()
    for changed, error, said in (
        ({"product": "PCIe-6363"}, InputError, "'PCIe-6363': device cDAQ1 is a cDAQ-9189"),
        ({"name": "cDAQ7"}, DeviceNotFound, "device cDAQ7: no such device"),
    ):
        with pytest.raises(error, match=said):
            open_backend(address, config.model_copy(update={"device": config.device.model_copy(update=changed)}))


@pytest.mark.parametrize("url", ["ni://host", "ni-grpc://", "ni-grpc:///x", "ni-grpc://host:99999"])
def test_bad_addresses_are_refused(url, config) -> None:
    with pytest.raises(InputError):
        open_backend(url, config)


def test_an_address_of_ipv6_keeps_its_brackets() -> None:
    with pytest.raises(HardwareFault, match=r"server \[::1\]:1\b"):
        reset_server("ni-grpc://[::1]:1")


def test_the_channel_is_closed_with_the_backend() -> None:
    channel = grpc.insecure_channel("127.0.0.1:1")
    NidaqmxBackend(channel, name="nobody").close()
    with pytest.raises(ValueError, match="closed"):
        channel.unary_unary("/x/y")(b"")


def test_blocks_while_nothing_is_commanded_keep_within_a_short_watchdog(config) -> None:
    dear = CallDelay(2e-3, 2e-3)
    short = config.watchdog.model_copy(update={"timeout_s": 0.06})
    assert calm_block_s(config, dear) == 0.05
    assert calm_block_s(config.model_copy(update={"watchdog": short}), dear) == 0.03
