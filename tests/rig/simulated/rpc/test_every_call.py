"""Every call of NI's service: the rig's are answered, every other call and property is refused by its name.

An empty one is answered or refused by a status of the driver; no defect.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2

from rig import HardwareFault, RigConfig, load_rig
from rig.daq.address import discover
from rig.simulated.rpc.calls import DEVICE_CALLS, PROPERTIES, TASK_CALLS
from rig.simulated.rpc.messages import CALLS, REFUSALS, enum, property_name, request_class, rpc_status
from rig.simulated.status import DaqStatusError

KINDS = {
    "AI": (
        "CreateAIVoltageChan",
        {"physical_channel": "Dev1/ai0", "min_val": -1.0, "max_val": 1.0, "units_raw": 10348},
    ),
    "AO": (
        "CreateAOVoltageChan",
        {"physical_channel": "Dev1/ao1", "min_val": -1.0, "max_val": 1.0, "units_raw": 10348},
    ),
    "DO": ("CreateDOChan", {"lines": "Dev1/port0/line3", "line_grouping_raw": 1}),
    "CO": (
        "CreateCOPulseChanFreq",
        {"counter": "Dev1/ctr0", "freq": 1e3, "duty_cycle": 0.5, "units_raw": 10373, "idle_state_raw": 10214},
    ),
}
ATTRIBUTE = re.compile(r"(Get|Set|Reset)(\w+?)Attribute\w*")
CLIENTS_OWN = {
    *(f"Device {name}" for name in ("PRODUCT_CATEGORY", "AI_SIMULTANEOUS_SAMPLING_SUPPORTED")),
    *(f"Device {kind}_PHYSICAL_CHANS" for kind in ("AI", "AO", "CI", "CO")),
    *(f"Device {kind}_{what}" for kind in ("DI", "DO") for what in ("LINES", "PORTS")),
    *("Read AVAIL_SAMP_PER_CHAN", "Read 0x31E8", "Write NUM_CHANS", "Write DIGITAL_LINES_BYTES_PER_CHAN"),
    *("Chan AI_MEAS_TYPE", "GetErrorString", "WaitUntilTaskDone"),
}
"""What the table has for programs of the client's own."""


def name_call(call: str, request: Any) -> str:
    """Name a call, or the property that it gets or sets."""
    if match := ATTRIBUTE.fullmatch(call):
        return f"{match[2]} {property_name(match[2], enum(request, 'attribute'))}"
    return call


@pytest.fixture
def seen(make_backend, intercept) -> Iterator[Callable[[str], tuple[Any, RigConfig, set[str]]]]:
    """Make the bench of a rig file; returns it, the rig, and what is asked of it from then on."""
    names: set[str] = set()
    with contextlib.ExitStack() as stack:

        def make(rig: str) -> tuple[Any, RigConfig, set[str]]:
            config = load_rig(rig).config
            backend = make_backend(config)
            stack.enter_context(intercept(backend, lambda call, request: names.add(name_call(call, request))))
            backend.identify(config)
            return backend, config, names

        yield make


def test_the_table_is_what_the_rig_asks(seen, begin, command: np.ndarray, served, on_any_machine) -> None:
    """A trial, a trial without motor, and all that self-test and calibrations ask, on three rigs; discovery."""
    for name in ("virtual", "pcie6363", "chassis_and_card"):
        backend, config, names = seen(name)
        begin(backend, 100, config, command)
        backend.read_positions()
        backend.safe_stop()
        begin(backend, 100, config, None)
        if name != "virtual":
            continue
        backend.safe_stop()
        backend.shunt_step(config)
        backend.count_edges(config, config.encoders[0].counter, config.camera.terminal, 0.01, True)
        backend.configure(config, command)
        backend.arm()
        backend.start()
        with contextlib.suppress(HardwareFault):
            backend.let_watchdog_expire(1000, 5)
        backend.safe_stop()
        discover(served(backend)[1])
    answered = {*DEVICE_CALLS, *TASK_CALLS, *(f"{kind} {property_name(kind, n)}" for kind, n in PROPERTIES)}
    assert names | CLIENTS_OWN == answered


def test_every_other_call_is_refused_by_its_name(make_backend) -> None:
    service = make_backend(load_rig("pcie6363").config).service
    others = CALLS - {*DEVICE_CALLS, *TASK_CALLS}
    assert len(others) > 400 and {*DEVICE_CALLS, *TASK_CALLS} <= CALLS
    for call in sorted(others):
        with pytest.raises(DaqStatusError, match=rf"-?{call}\b.*rig.daq never asks for it") as refusal:
            service.handle(call, request_class(call)())
        assert refusal.value.code == -200452 and "\n" not in str(refusal.value)


def test_every_other_property_is_refused_by_its_name(make_backend) -> None:
    service = make_backend(load_rig("pcie6363").config).service
    service.handle("CreateTask", request_class("CreateTask")(session_name="t"))
    count = 0
    for call in (
        "GetChanAttributeDouble",
        "GetTrigAttributeInt32",
        "SetTimingAttributeDouble",
        "GetDeviceAttributeBool",
    ):
        category = ATTRIBUTE.fullmatch(call)[2]
        prefix = {"Chan": "CHANNEL", "Trig": "TRIGGER"}.get(category, category.upper()) + "_ATTRIBUTE_"
        named = {getattr(nidaqmx_pb2, name) for name in dir(nidaqmx_pb2) if name.startswith(prefix)}
        for number in sorted(named - {number for kind, number in PROPERTIES if kind == category} - {0}):
            with pytest.raises(DaqStatusError, match=f"{call} of {property_name(category, number)}:"):
                service.handle(call, request_class(call)(attribute_raw=number))
            count += 1
    assert count > 600


def ask(service: Any, call: str, request: Any) -> str:
    """Return the gRPC status of one call; whatever is no refusal comes through."""
    try:
        service.handle(call, request)
    except REFUSALS as error:
        return rpc_status(error)[0].name
    return "OK"


def with_tasks(make_backend) -> Any:
    service = make_backend(load_rig("pcie6363").config).service
    for name, (call, fields) in KINDS.items():
        service.handle("CreateTask", request_class("CreateTask")(session_name=name))
        request = request_class(call)(**fields)
        request.task.name = name
        assert ask(service, call, request) == "OK"
    return service


def test_an_empty_request_of_every_call_is_answered_or_refused(make_backend) -> None:
    service = with_tasks(make_backend)
    answers = {call: ask(service, call, request_class(call)()) for call in sorted(CALLS)}
    assert set(answers.values()) <= {"OK", "UNKNOWN"}
