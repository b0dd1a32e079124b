"""What the virtual bench answers: the one table of calls and properties. Anything else is refused by its name.

They are what ``rig.daq`` asks in discovery, recording, passive recording, self-test, calibrations and felt presses
(tests/rig/simulated/rpc/test_every_call.py records them and compares), and, marked so, what NI's client asks when one
of its programs uses ``Task.read``, ``Task.write``, ``Task.wait_until_done`` and the lists of a device's channels.
"""

from __future__ import annotations

from rig.simulated import daqmx
from rig.simulated.driver import clear_task, start_task, stop_task
from rig.simulated.rpc import channels, data, device, properties, task
from rig.simulated.rpc.messages import DeviceHandler, Property, TaskHandler, property_number
from rig.simulated.rpc.properties import channel_property, channel_setting, sample_count, task_property, task_setting
from rig.simulated.status import text_of

DEVICE_CALLS: dict[str, DeviceHandler] = {
    "CreateTask": device.open_task,
    "ResetDevice": device.reset_named_device,
    "GetErrorString": lambda state, request: {"error_string": text_of(request.error_code)},
    "CreateWatchdogTimerTaskEx": device.open_watchdog,
    "CfgWatchdogAOExpirStates": device.set_analog_states,
    "CfgWatchdogDOExpirStates": device.set_line_states,
    "ControlWatchdogTask": device.control_timer,
}
TASK_CALLS: dict[str, TaskHandler] = {
    "CreateAIForceBridgeTwoPointLinChan": channels.add_force_bridge,
    "CreateAIVoltageChan": channels.add_voltage_input,
    "CreateAOVoltageChan": channels.add_voltage_output,
    "CreateCIAngEncoderChan": channels.add_encoder,
    "CreateCICountEdgesChan": channels.add_edge_count,
    "CreateCOPulseChanFreq": channels.add_pulse_train,
    "CreateDOChan": channels.add_digital_output,
    "CfgSampClkTiming": task.set_sample_clock,
    "CfgImplicitTiming": task.set_implicit_timing,
    "CfgDigEdgeStartTrig": task.set_start_trigger,
    "ExportSignal": task.export_clock,
    "TaskControl": task.control_task,
    "StartTask": lambda state, one, request: start_task(state, one),
    "StopTask": lambda state, one, request: stop_task(state, one),
    "ClearTask": lambda state, one, request: clear_task(state, one.name),
    "IsTaskDone": task.is_task_done,
    "WaitUntilTaskDone": task.await_task_end,  # for programs of the client's own
    "ReadAnalogF64": data.make_reader("AI"),
    "ReadCounterF64Ex": data.make_reader("CI"),
    "WriteAnalogF64": data.write_analog,
    "WriteAnalogScalarF64": data.write_analog_scalar,
    "WriteDigitalLines": data.write_lines,
}

READ_DEFAULT_SAMPLES = 0x31E8  # a property of newer drivers without a name in the service
_NAMED: dict[tuple[str, str], Property] = {
    # the system and its devices
    **{("SystemInfo", name): device.version_property(number) for name, number in device.VERSION.items()},
    ("SystemInfo", "DEV_NAMES"): Property(lambda state, request: ", ".join(state.inventory.devices())),
    ("Device", "PRODUCT_TYPE"): device.device_property(lambda one, name: one.own_devices()[name]),
    ("Device", "IS_SIMULATED"): device.device_property(lambda one, name: True),  # it does not pretend to be hardware
    ("Device", "SERIAL_NUM"): device.device_property(lambda one, name: 0),  # a simulated device has no serial number
    ("Device", "CHASSIS_MODULE_DEV_NAMES"): device.device_property(device.module_names),
    ("Device", "COMPACT_DAQ_SLOT_NUM"): device.device_property(device.slot_number),
    # lists of a device's channels, for the client's own programs
    ("Device", "PRODUCT_CATEGORY"): device.device_property(device.product_category),
    ("Device", "AI_SIMULTANEOUS_SAMPLING_SUPPORTED"): device.device_property(device.has_simultaneous_sampling),
    ("Device", "AI_PHYSICAL_CHANS"): device.device_property(device.channels_getter("bridge", "voltage_in")),
    ("Device", "AO_PHYSICAL_CHANS"): device.device_property(device.channels_getter("voltage_out")),
    **{
        ("Device", f"{d}_LINES"): device.device_property(device.channels_getter("line", "static_line"))
        for d in ("DI", "DO")
    },
    **{("Device", f"{d}_PORTS"): device.device_property(device.list_ports) for d in ("DI", "DO")},
    **{
        ("Device", f"{c}_PHYSICAL_CHANS"): device.device_property(device.channels_getter("counter"))
        for c in ("CI", "CO")
    },
    # watchdog
    ("Watchdog", "HAS_EXPIRED"): Property(device.has_expired),
    # tasks
    ("Task", "NAME"): task_property(lambda state, one: one.name),
    ("Task", "CHANNELS"): task_property(properties.list_channel_names),
    ("Timing", "SAMP_CLK_RATE"): task_property(properties.sample_rate),
    ("Read", "CHANNELS_TO_READ"): task_property(properties.list_channel_names),
    ("Read", "NUM_CHANS"): task_property(lambda state, one: len(one.channels)),
    ("Read", "CURR_READ_POS"): sample_count("read"),
    ("Read", "TOTAL_SAMP_PER_CHAN_ACQUIRED"): sample_count("acquired"),
    ("Read", "OVERWRITE"): task_setting("Read", int, properties.check_overwrite),
    ("Buffer", "OUTPUT_BUF_SIZE"): task_setting("Buffer", int, properties.accept_any),
    ("Trig", "ARM_START_TRIG_TYPE"): task_setting("Trig", int, properties.check_arm_type),
    ("Trig", "DIG_EDGE_ARM_START_TRIG_SRC"): task_setting("Trig", str, properties.check_arm_source),
    ("Trig", "DIG_EDGE_ARM_START_TRIG_EDGE"): task_setting("Trig", int, properties.check_rising),
    # Task.read and Task.write, for the client's own programs
    ("Read", "AVAIL_SAMP_PER_CHAN"): sample_count("available"),
    ("Write", "NUM_CHANS"): task_property(lambda state, one: len(one.channels)),
    ("Write", "DIGITAL_LINES_BYTES_PER_CHAN"): task_property(lambda state, one: data.largest_line_count(one)),
    # channels
    ("Chan", "CHAN_TYPE"): channel_property("", lambda state, one, channel: properties.CHANNEL_TYPE[one.type or ""]),
    ("Chan", "CI_MEAS_TYPE"): channel_property(
        "CI", lambda state, one, channel: properties.COUNT_EDGES if one.counts_edges else properties.ANGULAR_ENCODER
    ),
    ("Chan", "AI_MEAS_TYPE"): channel_property(
        "AI",
        lambda state, one, channel: daqmx.VOLTAGE if channel.physical.kind != "bridge" else properties.FORCE_BRIDGE,
    ),
    ("Chan", "AI_DEV_SCALING_COEFF"): channel_property("AI", properties.scaling_coefficients),
    ("Chan", "CO_PULSE_FREQ"): channel_property("CO", lambda state, one, channel: channel.settings["pulse_hz"]),
    ("Chan", "CO_PULSE_FREQ_INITIAL_DELAY"): channel_property(
        "CO", lambda state, one, channel: channel.settings["delay_s"]
    ),
    ("Chan", "AI_BRIDGE_SHUNT_CAL_ENABLE"): channel_setting("AI", bool, properties.check_bridge),
    ("Chan", "CI_COUNT_EDGES_TERM"): channel_setting("CI", str, properties.check_terminal),
    ("Chan", "CI_ENCODER_A_INPUT_TERM"): channel_setting("CI", str, properties.check_terminal),
    ("Chan", "CI_ENCODER_B_INPUT_TERM"): channel_setting("CI", str, properties.check_terminal),
    ("Chan", "CI_ENCODER_A_INPUT_DIG_FLTR_ENABLE"): channel_setting("CI", bool, properties.accept_any),
    ("Chan", "CI_ENCODER_B_INPUT_DIG_FLTR_ENABLE"): channel_setting("CI", bool, properties.accept_any),
    ("Chan", "CI_ENCODER_A_INPUT_DIG_FLTR_MIN_PULSE_WIDTH"): channel_setting("CI", float, properties.accept_any),
    ("Chan", "CI_ENCODER_B_INPUT_DIG_FLTR_MIN_PULSE_WIDTH"): channel_setting("CI", float, properties.accept_any),
    ("Chan", "CO_PULSE_TERM"): channel_setting("CO", str, properties.check_output_terminal),
}
PROPERTIES: dict[tuple[str, int], Property] = {
    ("Read", READ_DEFAULT_SAMPLES): task_property(properties.default_sample_count),
    **{(category, property_number(category, name)): answer for (category, name), answer in _NAMED.items()},
}
"""By category and the driver's number."""
