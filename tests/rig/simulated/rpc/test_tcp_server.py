"""The virtual device over TCP, seen by a client that speaks NI's service without our rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import grpc
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as stubs

from rig.configuration.rig_file import load_rig
from rig.errors import HardwareFault
from rig.simulated.rpc.tcp_server import serve


@pytest.fixture
def served(make_backend) -> Iterator[tuple[Any, Any]]:
    """A PCIe-6363 on the loopback: (stub, virtual device)."""
    backend = make_backend(load_rig("pcie6363").config)
    server, port = serve(backend.service)
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        yield stubs.NiDAQmxStub(channel), backend.device
    server.stop(None).wait()


def new_task(stub: Any, name: str = "") -> Any:
    return stub.CreateTask(messages.CreateTaskRequest(session_name=name)).task


def add_voltage_inputs(stub: Any, task: Any, channels: str, **changes: Any) -> None:
    fields = {"min_val": -10.0, "max_val": 10.0, "units": messages.VOLTAGE_UNITS2_VOLTS, **changes}
    stub.CreateAIVoltageChan(messages.CreateAIVoltageChanRequest(task=task, physical_channel=channels, **fields))


def test_a_finite_acquisition_of_several_channels(served) -> None:
    stub, _ = served
    task = new_task(stub, "several")
    add_voltage_inputs(stub, task, "Dev1/ai0:2")
    stub.CfgSampClkTiming(
        messages.CfgSampClkTimingRequest(
            task=task,
            rate=10_000.0,
            active_edge=messages.EDGE1_RISING,
            sample_mode=messages.ACQUISITION_TYPE_FINITE_SAMPS,
            samps_per_chan=400,
        )
    )
    assert stub.StartTask(messages.StartTaskRequest(task=task)).status == 0
    number = messages.GetTaskAttributeUInt32Request(task=task, attribute=messages.TASK_ATTRIBUTE_NUM_CHANS)
    assert stub.GetTaskAttributeUInt32(number).value == 3
    request = {"task": task, "num_samps_per_chan": 100, "array_size_in_samps": 300, "timeout": 1.0}
    by_channel = stub.ReadAnalogF64(
        messages.ReadAnalogF64Request(fill_mode=messages.GROUP_BY_GROUP_BY_CHANNEL, **request)
    )
    by_scan = stub.ReadAnalogF64(
        messages.ReadAnalogF64Request(fill_mode=messages.GROUP_BY_GROUP_BY_SCAN_NUMBER, **request)
    )
    cell_v = 0.05 * 10 / 111.2
    for rows in (np.reshape(by_channel.read_array, (3, 100)), np.reshape(by_scan.read_array, (100, 3)).T):
        np.testing.assert_allclose(rows[0], cell_v, atol=20 / 2**16)
        assert not rows[1:].any()
    late = stub.ReadAnalogF64(messages.ReadAnalogF64Request(**{**request, "timeout": 0.0}))
    assert (late.status, late.samps_per_chan_read) == (-200284, 0)
    stub.ClearTask(messages.ClearTaskRequest(task=task))


def test_one_value_on_an_output(served) -> None:
    stub, device = served
    task = new_task(stub)
    stub.CreateAOVoltageChan(
        messages.CreateAOVoltageChanRequest(
            task=task, physical_channel="Dev1/ao1", min_val=-10, max_val=10, units=messages.VOLTAGE_UNITS2_VOLTS
        )
    )
    stub.StartTask(messages.StartTaskRequest(task=task))
    write = messages.WriteAnalogF64Request(task=task, num_samps_per_chan=1, write_array=[1.5])
    assert stub.WriteAnalogF64(write).samps_per_chan_written == 1
    stub.ClearTask(messages.ClearTaskRequest(task=task))
    assert device.output_v == {"Dev1/ao1": 1.5}


def test_refusals_carry_the_driver_status_and_unknown_calls_are_the_drivers_too(served) -> None:
    stub, _ = served
    task = new_task(stub)
    for code, channels, changes in ((-200170, "Dev1/ai99", {}), (-200077, "Dev1/ai1", {"max_val": 11.0})):
        with pytest.raises(grpc.RpcError) as refusal:
            add_voltage_inputs(stub, task, channels, **changes)
        assert ("ni-error", str(code)) in [tuple(entry) for entry in refusal.value.trailing_metadata()]
    for call, request in (
        (stub.CreateCISemiPeriodChan, messages.CreateCISemiPeriodChanRequest(task=task)),
        (stub.CreateWatchdogTimerTask, messages.CreateWatchdogTimerTaskRequest()),
    ):
        with pytest.raises(grpc.RpcError) as refusal:
            call(request)
        assert refusal.value.code() == grpc.StatusCode.UNKNOWN and dict(refusal.value.trailing_metadata())["ni-error"]
    stream = stub.RegisterSignalEvent(messages.RegisterSignalEventRequest(task=task, signal_id_raw=12494))
    with pytest.raises(grpc.RpcError) as refusal:
        next(stream)
    assert dict(refusal.value.trailing_metadata())["ni-error"] == "-200452"


@pytest.mark.parametrize("call", ["StartTask", "ReadAnalogF64", "WriteAnalogF64", "CfgSampClkTiming", "TaskControl"])
def test_requests_with_nothing_in_them_are_refused_not_crashed_on(call, served) -> None:
    stub, _ = served
    with pytest.raises(grpc.RpcError) as refusal:
        getattr(stub, call)(getattr(messages, f"{call}Request")())
    assert ("ni-error", "-200088") in [tuple(entry) for entry in refusal.value.trailing_metadata()]


def test_a_port_that_is_taken_is_a_clear_fault(make_backend) -> None:
    backend = make_backend(load_rig("virtual").config)
    server, port = serve(backend.service)
    try:
        with pytest.raises(HardwareFault, match="cannot be bound"):
            serve(backend.service, port=port)
    finally:
        server.stop(None).wait()
