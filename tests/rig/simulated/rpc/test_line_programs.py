"""What programs written for an NI card do with its lines, and with the card itself, on the virtual card."""

from __future__ import annotations

import nidaqmx
import pytest
from nidaqmx import constants as ni
from nidaqmx.errors import DaqReadError

FINITE, CONTINUOUS = ni.AcquisitionType.FINITE, ni.AcquisitionType.CONTINUOUS


def test_lines_and_ports_are_written_and_read_and_changes_are_detected(card) -> None:
    out, port, changes = card.task(), card.task(), card.task()
    out.do_channels.add_do_chan("Dev1/port0/line0:3", line_grouping=ni.LineGrouping.CHAN_PER_LINE)
    port.di_channels.add_di_chan("Dev1/port0", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    changes.di_channels.add_di_chan("Dev1/port0/line0:1", line_grouping=ni.LineGrouping.CHAN_PER_LINE)
    changes.timing.cfg_change_detection_timing(
        rising_edge_chan="Dev1/port0/line0:1", falling_edge_chan="Dev1/port0/line0", sample_mode=CONTINUOUS
    )
    changes.start()
    assert out.write([True, False, True, True], auto_start=True) == 1
    assert port.read() == 0b1101
    out.write([True, False, False, True], auto_start=True)  # line 2 is not watched
    out.write([True, True, False, True], auto_start=True)
    assert changes.read(2, timeout=0.1) == [[True, True], [False, True]]
    with pytest.raises(DaqReadError, match="-200284"):
        changes.read(1, timeout=0.1)
    whole = card.task()
    with pytest.raises(nidaqmx.errors.DaqError, match="-50103"):
        whole.do_channels.add_do_chan("Dev1/port0", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
        out.control(ni.TaskMode.TASK_RESERVE)
        whole.write(0xFFFF, auto_start=True)
    out.control(ni.TaskMode.TASK_UNRESERVE)
    whole.write(0xFFFF, auto_start=True)
    assert port.read() == 0xFFFF


def test_lines_have_clocks_on_port_0_only(card, refused) -> None:
    out = card.task()
    out.do_channels.add_do_chan("Dev1/port0/line0:7", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    out.timing.cfg_samp_clk_timing(1000.0, sample_mode=FINITE, samps_per_chan=3)
    out.write([1, 2, 4], auto_start=True)
    out.wait_until_done(timeout=1.0)
    back = card.task()
    back.di_channels.add_di_chan("Dev1/port0/line0:7", line_grouping=ni.LineGrouping.CHAN_FOR_ALL_LINES)
    back.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=5)
    assert back.read(5) == [4] * 5
    static = card.task()
    static.do_channels.add_do_chan("Dev1/port1/line0")
    with refused(-200452):
        static.timing.cfg_samp_clk_timing(1000.0)


def test_a_reset_clears_what_a_dead_client_left(card) -> None:
    from nidaqmx.system import Device

    task = card.task("left")
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    task.write(3.0, auto_start=True)
    device = Device("Dev1", grpc_options=nidaqmx.GrpcSessionOptions(card._channel, ""))
    assert [c.name for c in device.ao_physical_chans] == [f"Dev1/ao{i}" for i in range(4)]
    assert device.di_ports.channel_names == ["Dev1/port0", "Dev1/port1", "Dev1/port2"]
    assert len(device.ai_physical_chans) == 32 and len(device.ci_physical_chans) == 4
    device.self_test_device()
    device.reset_device()
    assert card.device.output_v["Dev1/ao0"] == 0.0 and card.device.tasks == {}
    card._tasks.remove(task)
    task._handle = None
