"""NI's DAQmx RPC service, answered by the virtual device: one handler per call, by the call's name.

Place in the data flow: an in-process channel or a TCP server hands requests in; both get the same answers.
A driver status below zero travels as the real server sends it (``ni-error`` in the trailing metadata, or a
status with partial data for reads that time out). A call that is not in the table raises
NotImplementedByDevice, which the client sees as UNIMPLEMENTED.
"""

from __future__ import annotations

import re
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.simulated import attributes, status
from rig.simulated.channel_setup import CHANNEL_CALLS
from rig.simulated.device import SimulatedDevice
from rig.simulated.messages import CALLS, attribute_value, enum, response, session
from rig.simulated.status import DaqStatusError, NotImplementedByDevice
from rig.simulated.tasks import SimulatedTask
from rig.simulated.watchdog_calls import WATCHDOG_CALLS

_ATTRIBUTE_CALL = re.compile(r"(Get|Set)(Task|Timing|Read|Write|Buffer|Chan|Trig)Attribute(\w+)")
_BY_SCAN = 1
POLL_S = 1e-3
"""Bench time that passes when a client asks whether a task is done."""
TRACE_LENGTH = 100_000
START, STOP, VERIFY, COMMIT, RESERVE, UNRESERVE, ABORT = range(7)


class Service:
    """Answers the calls of a DAQmx client from one virtual device; calls are handled one at a time."""

    def __init__(self, device: SimulatedDevice) -> None:
        self.device = device
        self.trace: list[str] = []
        """Names of the calls so far, the last 50,000 at least."""
        self._lock = threading.RLock()
        self._handlers: dict[str, Callable[[Any], Any]] = {
            "CreateTask": self._create_task,
            "ClearTask": self._clear_task,
            "StartTask": self._start_task,
            "StopTask": self._stop_task,
            "TaskControl": self._task_control,
            "IsTaskDone": self._is_task_done,
            "WaitUntilTaskDone": self._wait_until_task_done,
            "CfgSampClkTiming": self._cfg_samp_clk_timing,
            "CfgImplicitTiming": self._cfg_implicit_timing,
            "CfgDigEdgeStartTrig": self._cfg_dig_edge_start_trig,
            "DisableStartTrig": self._disable_start_trig,
            "ReadAnalogF64": self._read_f64("ReadAnalogF64", "AI"),
            "ReadCounterF64Ex": self._read_f64("ReadCounterF64Ex", "CI"),
            "ReadCounterF64": self._read_f64("ReadCounterF64", "CI"),
            "ReadCounterU32": self._read_f64("ReadCounterU32", "CI"),
            "ReadCounterU32Ex": self._read_f64("ReadCounterU32Ex", "CI"),
            "ReadAnalogScalarF64": self._read_scalar("ReadAnalogScalarF64", "AI"),
            "ReadCounterScalarF64": self._read_scalar("ReadCounterScalarF64", "CI"),
            "ReadCounterScalarU32": self._read_scalar("ReadCounterScalarU32", "CI"),
            "WriteAnalogF64": self._write_analog_f64,
            "WriteAnalogScalarF64": self._write_analog_scalar_f64,
            "WriteDigitalLines": self._write_digital_lines,
            "GetSystemInfoAttributeUInt32": self._system_info,
            "GetSystemInfoAttributeString": self._system_info_string,
            "GetDeviceAttributeString": self._device_string,
            "GetDeviceAttributeBool": self._device_bool,
            "GetErrorString": self._error_string,
        }

    def alone(self) -> AbstractContextManager[bool]:
        """Keep clients waiting while the device is looked at."""
        return self._lock

    def handle(self, call: str, request: Any) -> Any:
        """Answer one call.

        Raises
        ------
        DaqStatusError
            When the device refuses, with the driver's status code.
        NotImplementedByDevice
            When the virtual device does not have the call.
        """
        with self._lock:
            self.device.watchdogs.look()
            self.device.faults.before_call(call, self.device)
            self.trace.append(sys.intern(call))
            if len(self.trace) > TRACE_LENGTH:
                del self.trace[: TRACE_LENGTH // 2]
            if call in self._handlers:
                return self._handlers[call](request)
            if call in CHANNEL_CALLS:
                CHANNEL_CALLS[call](self.device, self._task(request), request)
                return response(call)
            if call in WATCHDOG_CALLS:
                return WATCHDOG_CALLS[call](self.device, request)
            match = _ATTRIBUTE_CALL.fullmatch(call)
            if match and call in CALLS:
                return self._attribute(call, match.group(1), match.group(2), request)
            raise NotImplementedByDevice(call)

    def _task(self, request: Any) -> SimulatedTask:
        return self.device.task(request.task.name)

    def _task_of_type(self, request: Any, type_: str) -> SimulatedTask:
        task = self._task(request)
        if task.type != type_:
            raise DaqStatusError(status.WRONG_MEASUREMENT_TYPE, f"Task: {task.name} is {task.type}")
        return task

    def _create_task(self, request: Any) -> Any:
        task = self.device.create_task(request.session_name)
        return response("CreateTask", task=session(task.name), new_session_initialized=True)

    def _clear_task(self, request: Any) -> Any:
        self.device.clear_task(request.task.name)
        return response("ClearTask")

    def _start_task(self, request: Any) -> Any:
        self.device.start(self._task(request))
        return response("StartTask")

    def _stop_task(self, request: Any) -> Any:
        self.device.stop(self._task(request))
        return response("StopTask")

    def _task_control(self, request: Any) -> Any:
        task, action = self._task(request), enum(request, "action")
        if action == START:
            self.device.start(task)
        elif action in (STOP, ABORT):
            self.device.stop(task)
        elif action in (COMMIT, RESERVE):
            self.device.commit(task)
            task.committed = True
        elif action == UNRESERVE:
            self.device.release(task)
        elif action != VERIFY:
            raise DaqStatusError(status.INVALID_VALUE, f"Task action {action}")
        return response("TaskControl")

    def _is_task_done(self, request: Any) -> Any:
        task = self._task(request)
        # asking takes its time where nothing else lets it pass
        if not task.done and self.trace[-2:-1] == ["IsTaskDone"]:
            self.device.advance(max(int(POLL_S * self.device.bench.rate_hz), 1))
        return response("IsTaskDone", is_task_done=task.done)

    def _wait_until_task_done(self, request: Any) -> Any:
        task = self._task(request)
        rate_hz = self.device.bench.rate_hz
        forever = request.time_to_wait < 0
        left = task.to_do if forever else int(min(request.time_to_wait * rate_hz, task.to_do))
        if task.live and np.isfinite(left):
            self.device.advance(int(left))
        if not task.done:
            raise DaqStatusError(status.OPERATION_TIMED_OUT, f"Task: {task.name}")
        return response("WaitUntilTaskDone")

    def _cfg_samp_clk_timing(self, request: Any) -> Any:
        mode = enum(request, "sample_mode")
        self.device.configure_clock(
            self._task(request), request.rate, request.source, mode, int(request.samps_per_chan)
        )
        return response("CfgSampClkTiming")

    def _cfg_implicit_timing(self, request: Any) -> Any:
        task = self._task(request)
        if task.type != "CO":
            raise NotImplementedByDevice(f"implicit timing of a {task.type} task")
        return response("CfgImplicitTiming")

    def _cfg_dig_edge_start_trig(self, request: Any) -> Any:
        task = self._task(request)
        if task.type in ("AI", "CI"):
            raise NotImplementedByDevice(f"start trigger of a {task.type} task")
        task.start_trigger = self.device.inventory.terminal(request.trigger_source)
        return response("CfgDigEdgeStartTrig")

    def _disable_start_trig(self, request: Any) -> Any:
        self._task(request).start_trigger = ""
        return response("DisableStartTrig")

    def _read_f64(self, call: str, type_: str) -> Callable[[Any], Any]:
        def read(request: Any) -> Any:
            task = self._task_of_type(request, type_)
            wanted = int(request.num_samps_per_chan)
            values = self.device.read(task, wanted, request.timeout)
            came = values.shape[0]
            complete = came >= wanted
            filled = np.zeros((max(wanted, came), values.shape[1]))
            filled[:came] = values
            by_scan = "fill_mode" in request.DESCRIPTOR.fields_by_name and enum(request, "fill_mode") == _BY_SCAN
            flat = _counts_if(call, (filled if by_scan else filled.T).ravel())
            code = 0 if complete else status.SAMPLES_NOT_YET_AVAILABLE
            return response(call, status=code, read_array=flat, samps_per_chan_read=came)

        return read

    def _read_scalar(self, call: str, type_: str) -> Callable[[Any], Any]:
        def read(request: Any) -> Any:
            task = self._task_of_type(request, type_)
            if len(task.channels) != 1:
                raise DaqStatusError(status.TASK_MIXES_TYPES, f"Task: {task.name}: a scalar read needs one channel")
            values = self.device.read(task, 1, request.timeout)
            if not values.size:
                raise DaqStatusError(status.SAMPLES_NOT_YET_AVAILABLE, f"Task: {task.name}", samples_read=0)
            return response(call, value=_counts_if(call, values.ravel())[0])

        return read

    def _write_analog_f64(self, request: Any) -> Any:
        task = self._task(request)
        n, columns = int(request.num_samps_per_chan), len(task.channels)
        values = np.array(request.write_array, dtype=np.float64)
        if n * columns != values.size:
            raise DaqStatusError(-200524, f"{values.size} values for {columns} channels and {n} samples")
        by_scan = enum(request, "data_layout") == _BY_SCAN
        self.device.write(
            task, values.reshape(n, columns) if by_scan else values.reshape(columns, n).T, request.auto_start
        )
        return response("WriteAnalogF64", samps_per_chan_written=n)

    def _write_analog_scalar_f64(self, request: Any) -> Any:
        self.device.write(self._task(request), np.array([[request.value]]), request.auto_start)
        return response("WriteAnalogScalarF64")

    def _write_digital_lines(self, request: Any) -> Any:
        states = [bool(value) for value in request.write_array]
        self.device.write_lines(self._task(request), states, request.auto_start)
        return response("WriteDigitalLines", samps_per_chan_written=1)

    def _attribute(self, call: str, action: str, category: str, request: Any) -> Any:
        task = self._task(request)
        channel = getattr(request, "channel", "")
        number = enum(request, "attribute")
        if action == "Set":
            attributes.put(self.device, task, category, channel, number, attribute_value(request))
            return response(call)
        value = attributes.get(self.device, task, category, channel, number)
        field = "value_raw" if call.endswith("Int32") and not call.endswith("UInt32") else "value"
        return response(call, **{field: value})

    def _system_info(self, request: Any) -> Any:
        number = enum(request, "attribute")
        if number not in attributes.DRIVER_VERSION:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, f"Property: 0x{number:04X} (System)")
        return response("GetSystemInfoAttributeUInt32", value=attributes.DRIVER_VERSION[number])

    def _system_info_string(self, request: Any) -> Any:
        if enum(request, "attribute") != 0x193B:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (System)")
        return response("GetSystemInfoAttributeString", value=self.device.inventory.name)

    def _device_string(self, request: Any) -> Any:
        self._check_device(request.device_name)
        if enum(request, "attribute") != 0x0631:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Device)")
        return response("GetDeviceAttributeString", value=self.device.inventory.product.name)

    def _device_bool(self, request: Any) -> Any:
        self._check_device(request.device_name)
        if enum(request, "attribute") != 0x22CA:
            raise DaqStatusError(status.ATTRIBUTE_NOT_SUPPORTED, "Property (Device)")
        return response("GetDeviceAttributeBool", value=True)  # it says what it is

    def _check_device(self, name: str) -> None:
        if name.lower() != self.device.inventory.name.lower():
            raise DaqStatusError(status.INVALID_DEVICE, f"Device: {name}")

    def _error_string(self, request: Any) -> Any:
        return response("GetErrorString", error_string=status.TEXTS.get(request.error_code, "Unknown status code."))


def _counts_if(call: str, values: NDArray[np.float64]) -> NDArray[Any]:
    """Return the values as a 32-bit counter register holds them when the call asks for that."""
    return (values.astype(np.int64) % 2**32).astype(np.uint32) if "U32" in call else values
