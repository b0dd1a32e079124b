"""Every call of the service, empty or with random contents: an answer, a driver's status, UNIMPLEMENTED; no defect."""

from __future__ import annotations

import random
from typing import Any

import pytest
from google.protobuf.descriptor import FieldDescriptor

from rig.configuration.rig_file import load_rig
from rig.simulated.rpc.messages import CALLS, REFUSALS, request_class, rpc_status
from rig.simulated.rpc.service import EVENTS

TEXTS = ("", "x", "Dev9/ai0", "Dev1/ai0:999", "a,b", "\0", ",", ":", "OnboardClock", "Dev1", "Dev1/ai0:3", "Dev1/ao1")
TEXTS = (*TEXTS, "Dev1/ctr0", "Dev1/port0/line3", "/Dev1/PFI0", "ai/SampleClock", "ai", "co", "do")
WHOLE = (0, 1, 2, -1, 3, 10, 100, 1000, 10**6, 2**31 - 1, -(2**31), 10178, 10123, 10280, 10348, 10373)
REAL = (0.0, 1.0, -1.0, 1e-3, 1000.0, 5.0, float("nan"), float("inf"), float("-inf"), 1e300, 1e-300)
VOLTS = {"min_val": -1.0, "max_val": 1.0, "units_raw": 10348}
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


def ask(service: Any, call: str, request: Any) -> str:
    """Return the gRPC status of one call; whatever is no refusal comes through."""
    try:
        if call in EVENTS:
            service.stream(call, request).cancel()
        else:
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


def fill(draw: random.Random, message: Any) -> Any:
    """Put random contents into a message; timeouts stay short, as the test waits for them."""
    for field in message.DESCRIPTOR.fields:
        if field.name in ("timeout", "time_to_wait"):
            setattr(
                message, field.name, draw.choice((0.0, 0.01, float("nan"), -1.0 if field.name == "timeout" else 0.0))
            )
        elif field.name == "task":
            message.task.name = draw.choice((*KINDS, *KINDS, "", "gone"))
        elif draw.random() < 0.8 and field.type != FieldDescriptor.TYPE_MESSAGE:
            value = _value(draw, field)
            if not field.is_repeated:
                setattr(message, field.name, value)
            else:
                getattr(message, field.name).extend([value] * draw.choice((0, 1, 2, 8)))
    return message


def _value(draw: random.Random, field: FieldDescriptor) -> Any:
    if field.type == FieldDescriptor.TYPE_STRING:
        return draw.choice(TEXTS)
    if field.type == FieldDescriptor.TYPE_BYTES:
        return draw.choice((b"", b"\0", b"\1\0\1\1", b"\xff" * 9))
    if field.type == FieldDescriptor.TYPE_BOOL:
        return draw.random() < 0.5
    if field.type == FieldDescriptor.TYPE_ENUM:
        return draw.choice([value.number for value in field.enum_type.values])
    if field.type in (FieldDescriptor.TYPE_DOUBLE, FieldDescriptor.TYPE_FLOAT):
        return draw.choice(REAL)
    number = draw.choice(WHOLE)
    return abs(number) if field.type in (FieldDescriptor.TYPE_UINT32, FieldDescriptor.TYPE_UINT64) else number


def test_an_empty_request_of_every_call_is_answered_or_refused(make_backend) -> None:
    service = with_tasks(make_backend)
    answers = {call: ask(service, call, request_class(call)()) for call in sorted(CALLS)}
    assert set(answers.values()) <= {"OK", "UNKNOWN", "UNIMPLEMENTED"}
    assert sum(answer == "UNIMPLEMENTED" for answer in answers.values()) < 330


@pytest.mark.parametrize("seed", [1, 2])
def test_random_requests_of_every_call_are_answered_or_refused(seed, make_backend) -> None:
    draw, seen = random.Random(seed), set()
    for _ in range(4):
        service = with_tasks(make_backend)
        calls = [call for call in sorted(CALLS) if call not in ("ResetDevice", "ClearTask")]
        draw.shuffle(calls)
        seen |= {ask(service, call, fill(draw, request_class(call)())) for call in calls}
    assert seen <= {"OK", "UNKNOWN", "UNIMPLEMENTED", "ALREADY_EXISTS", "FAILED_PRECONDITION"}
