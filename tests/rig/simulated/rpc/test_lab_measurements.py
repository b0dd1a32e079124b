"""What labs use beside voltages and counts: thermocouples, logs in TDMS, pulses on a sample clock, scaled counters.

Custom scales of NI's client on the virtual device: what is measured, in the lab's own unit, and back for outputs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import GrpcSessionOptions, Scale
from nidaqmx import constants as ni
from nidaqmx.constants import EncoderZIndexPhase, UnitsPreScaled, VoltageUnits
from nidaqmx.errors import DaqError
from nidaqmx.types import CtrFreq

from rig.simulated.device.scales import E, J, K, T, ThermocoupleScale, millivolts

CONTINUOUS = ni.AcquisitionType.CONTINUOUS


@pytest.mark.parametrize(
    ("kind", "celsius", "table_mv"),
    [
        (J, (-100, 100, 370), (-4.633, 5.269, 20.194)), (K, (-100, 100, 1000), (-3.554, 4.096, 41.276)),
        (T, (-100, 100, 400), (-3.379, 4.279, 20.872)), (E, (-100, 100, 1000), (-5.237, 6.319, 76.373)),
    ],
)  # fmt: skip
def test_thermocouples_follow_the_reference_tables(kind: int, celsius: Any, table_mv: Any) -> None:
    np.testing.assert_allclose(millivolts(kind, celsius), table_mv, atol=6e-4)
    scale = ThermocoupleScale(kind, 22.0)
    np.testing.assert_allclose(scale.scaled(scale.prescaled(celsius)), celsius, atol=0.01)


def test_an_open_thermocouple_input_reads_the_cold_junction(card: Any, refused) -> None:
    task = card.task()
    channel = task.ai_channels.add_ai_thrmcpl_chan(
        "Dev1/ai2", units=ni.TemperatureUnits.DEG_F, thermocouple_type=ni.ThermocoupleType.T, cjc_val=22.0
    )
    assert channel.ai_thrmcpl_type == ni.ThermocoupleType.T and channel.ai_thrmcpl_cjc_val == 22.0
    assert channel.ai_meas_type == ni.UsageTypeAI.TEMPERATURE_THERMOCOUPLE
    assert task.read() == pytest.approx(22.0 * 1.8 + 32.0, abs=0.2)  # a step of the converter is 3 uV, 0.14 deg F
    with refused(-200576):
        card.task().ai_channels.add_ai_thrmcpl_chan("Dev1/ai3", cjc_source=ni.CJCSource.BUILT_IN)


def logged(card: Any, path: str, mode: ni.LoggingMode) -> nidaqmx.Task:
    task = card.inputs("Dev1/ai1:2", 50, name="logged")
    task.in_stream.configure_logging(path, mode, group_name="Blow", operation=ni.LoggingOperation.CREATE_OR_REPLACE)
    return task


@pytest.mark.parametrize("mode", [ni.LoggingMode.LOG, ni.LoggingMode.LOG_AND_READ])
def test_a_task_logs_what_it_acquires_to_a_tdms_file(
    card: Any, mode: ni.LoggingMode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nptdms = pytest.importorskip("nptdms")
    monkeypatch.chdir(tmp_path)
    out = card.task()
    out.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    out.write(1.5)
    task = logged(card, "blow.tdms", mode)
    assert task.in_stream.logging_mode == mode and task.in_stream.logging_tdms_group_name == "Blow"
    task.start()
    if mode == ni.LoggingMode.LOG:
        with pytest.raises(DaqError, match="-201301"):
            task.read(10)
        task.wait_until_done()
        values = np.full((2, 50), [[1.5], [0.0]])
    else:
        values = np.array(task.read(ni.READ_ALL_AVAILABLE))
    task.stop()
    channels = nptdms.TdmsFile.read("blow.tdms")["Blow"].channels()
    written = np.array([channel[:] for channel in channels])
    assert written.shape == values.shape == (2, 50)
    np.testing.assert_allclose(written[:, 1:], values[:, 1:], atol=1e-3)  # the first is before the output has settled
    assert values[0, 1:] == pytest.approx(1.5, abs=1e-3)
    assert channels[0].properties["wf_increment"] == 1e-3 and channels[0].name == "Dev1/ai1"


def test_logging_is_refused_where_the_driver_refuses_it(card: Any, tmp_path: Path, monkeypatch: Any) -> None:
    pytest.importorskip("nptdms")
    monkeypatch.chdir(tmp_path)
    outside = logged(card, "/tmp/../elsewhere.tdms", ni.LoggingMode.LOG)
    with pytest.raises(DaqError, match="logs into"):
        outside.start()
    on_demand = card.task()
    on_demand.ai_channels.add_ai_voltage_chan("Dev1/ai3")
    on_demand.in_stream.configure_logging("x.tdms", operation=ni.LoggingOperation.CREATE)
    with pytest.raises(DaqError, match="-201299"):
        on_demand.start()
    assert not list(tmp_path.iterdir())


def test_each_tick_of_its_clock_gives_a_counter_output_new_pulses(card: Any) -> None:
    clock, pulses = card.pulses(10.0, "Dev1/ctr1", initial_delay=0.1), card.task()  # the clock on PFI13
    measured = card.inputs("Dev1/ai1", rate_hz=10_000.0)
    channel = pulses.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=1000.0)  # on PFI12
    pulses.timing.cfg_samp_clk_timing(10.0, "/Dev1/PFI13", sample_mode=CONTINUOUS)
    pulses.out_stream.output_buf_size = 3
    pulses.write([CtrFreq(1000.0, 0.5), CtrFreq(500.0, 0.25), CtrFreq(250.0, 0.75)])
    assert pulses.timing.samp_timing_type == ni.SampleTimingType.SAMPLE_CLOCK
    for task in (measured, pulses, clock):
        task.start()
    seen = []
    for _ in range(4):
        measured.read(900, timeout=1.0)
        seen.append((round(channel.co_pulse_freq), round(channel.co_pulse_duty_cyc, 2)))
        measured.read(100, timeout=1.0)
    assert seen == [(1000, 0.5), (500, 0.25), (250, 0.75), (1000, 0.5)]


def test_an_encoder_reads_in_a_scale_of_the_labs_own(card: Any, options) -> None:
    Scale.create_lin_scale(
        "key_front_mm", 0.22 * np.pi / 180 * 1000, 1.0, ni.UnitsPreScaled.DEGREES, "mm", grpc_options=options
    )
    degrees, scaled = card.task(), card.task()
    common = {"pulses_per_rev": 81920, "initial_angle": 3.0}
    plain = degrees.ci_channels.add_ci_ang_encoder_chan("Dev1/ctr0", units=ni.AngleUnits.DEGREES, **common)
    mm = scaled.ci_channels.add_ci_ang_encoder_chan(
        "Dev1/ctr1", units=ni.AngleUnits.FROM_CUSTOM_SCALE, custom_scale_name="key_front_mm", **common
    )
    for channel in (plain, mm):
        channel.ci_encoder_a_input_term, channel.ci_encoder_b_input_term = "/Dev1/PFI8", "/Dev1/PFI10"
    assert mm.ci_custom_scale.name == "key_front_mm" and mm.ci_ang_encoder_units == ni.AngleUnits.FROM_CUSTOM_SCALE
    assert degrees.read() == pytest.approx(3.0)
    assert scaled.read() == pytest.approx(1.0 + 3.0 * 0.22 * np.pi / 180 * 1000)
    with pytest.raises(DaqError, match="-200378"):
        card.task().ci_channels.add_ci_ang_encoder_chan(
            "Dev1/ctr2", units=ni.AngleUnits.FROM_CUSTOM_SCALE, custom_scale_name="none"
        )


def test_a_frequency_reads_in_a_scale_of_the_labs_own(card: Any, options) -> None:
    hertz, litres = [0.0, 100.0, 1000.0], [0.0, 1.0, 20.0]
    Scale.create_table_scale("flow", hertz, litres, ni.UnitsPreScaled.HERTZ, grpc_options=options)
    counted = card.task()
    card.pulses(550.0).start()
    counted.ci_channels.add_ci_freq_chan(
        "Dev1/ctr1", min_val=0.1, max_val=20.0, units=ni.FrequencyUnits.FROM_CUSTOM_SCALE, custom_scale_name="flow"
    ).ci_freq_term = "/Dev1/PFI12"
    assert counted.read() == pytest.approx(10.5, rel=1e-4)


@pytest.fixture
def options(card) -> GrpcSessionOptions:
    return GrpcSessionOptions(card._channel, "")


def in_scale(name: str, low: float, high: float) -> dict[str, Any]:
    return {"min_val": low, "max_val": high, "units": VoltageUnits.FROM_CUSTOM_SCALE, "custom_scale_name": name}


def looped(card: Any, written: list[float], limit: float) -> list[float]:
    """Write on demand, in newtons, to the output that ``ai1`` is wired to; read in newtons."""
    out, back = card.task(), card.task()
    out.ao_channels.add_ao_voltage_chan("Dev1/ao0", **in_scale("newtons", -limit, limit))
    back.ai_channels.add_ai_voltage_chan("Dev1/ai1", **in_scale("newtons", -limit, limit))
    read = []
    for value in written:
        out.write(value)
        read.append(back.read())
    return read


def test_each_scale_reads_in_its_unit(card, options) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, scaled_units="N", grpc_options=options)
    Scale.create_map_scale("percent", -10.0, 10.0, 0.0, 100.0, grpc_options=options)
    Scale.create_table_scale("table", [0.0, 4.0, 1.0], [0.0, 10.0, 1.0], grpc_options=options)
    Scale.create_polynomial_scale("square", [0.0, 1.0, 0.5], [0.0, 1.0], grpc_options=options)
    rules = {
        "newtons": (lambda v: 12 * v - 3, 12.0),
        "percent": (lambda v: 50 + 5 * v, 5.0),
        "TABLE": (lambda v: np.interp(v, [0, 1, 4], [0, 1, 10]), 3.0),
        "square": (lambda v: v + 0.5 * v * v, 6.0),
    }
    plain = card.task()
    plain.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    for name, (rule, slope) in rules.items():
        back = card.task()
        channel = back.ai_channels.add_ai_voltage_chan("Dev1/ai1", **in_scale(name, 0.0, 5.0))
        channel.ai_rng_high, channel.ai_rng_low = 10.0, -10.0
        for v in (-2.0, 0.0, 0.5, 2.5, 5.0):
            plain.write(v)
            assert back.read() == pytest.approx(float(rule(v)), abs=2 * slope * 10 / 2**15)


def test_what_is_written_in_a_scale_is_read_in_it(card, options) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, grpc_options=options)
    written = [-20.0, 0.0, 7.5, 50.0]
    np.testing.assert_allclose(looped(card, written, 60.0), written, atol=12 * 10 / 2**14)
    assert card.device.output_v["Dev1/ao0"] == pytest.approx((50.0 + 3.0) / 12.0)


def test_codes_of_a_converter_have_no_scale(card, options, refused) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, grpc_options=options)
    task = card.task()
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0", **in_scale("newtons", -60.0, 60.0))
    with refused(-200452):
        task.out_stream.write(np.array([2**13], dtype=np.int16))
    assert card.device.output_v.get("Dev1/ao0", 0.0) == 0.0


def test_a_scale_of_other_units_or_none_does_not_take_the_place_of_a_channels_own(card, options, refused) -> None:
    of_amperes = Scale.create_lin_scale("a", 2.0, 0.5, UnitsPreScaled.AMPS, grpc_options=options)
    channel = card.task().ai_channels.add_ai_voltage_chan("Dev1/ai0")
    with refused(-200077):
        channel.ai_custom_scale = of_amperes
    hot = card.task()
    thermocouple = hot.ai_channels.add_ai_thrmcpl_chan(
        "Dev1/ai2", cjc_source=ni.CJCSource.CONSTANT_USER_VALUE, cjc_val=21.0
    )
    with refused(-200452):
        del thermocouple.ai_custom_scale
    assert hot.read() == pytest.approx(21.0, abs=10.0)


def test_a_value_beyond_the_outputs_volts_is_refused(card, options, refused) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, grpc_options=options)
    with refused(-200077):
        looped(card, [0.0], 200.0)  # 16.9 V
    with refused(-200561):
        looped(card, [61.0], 60.0)


def test_properties_are_those_it_was_made_with_and_can_be_changed(card, options) -> None:
    scale = Scale.create_lin_scale("a", 2.0, 0.5, UnitsPreScaled.VOLTS, "N", grpc_options=options)
    assert (scale.lin_slope, scale.lin_y_intercept, scale.scaled_units, scale.description) == (2.0, 0.5, "N", "")
    scale.lin_slope, scale.description = 4.0, "of the cell"
    assert (scale.lin_slope, scale.description) == (4.0, "of the cell")
    for ask in (lambda: scale.table_scaled_vals, lambda: setattr(scale, "lin_slope", 0.0)):
        with pytest.raises(nidaqmx.errors.DaqError):
            ask()
    assert scale.lin_slope == 4.0
    channel = card.task().ai_channels.add_ai_voltage_chan("Dev1/ai0", **in_scale("a", -5.0, 5.0))
    assert channel.ai_custom_scale.name == "a" and channel.ai_voltage_units == VoltageUnits.FROM_CUSTOM_SCALE
    assert (channel.ai_max, channel.ai_min) == (8.5, -7.5)  # 1.4 V asked: the range is 2 V
    del channel.ai_custom_scale
    assert channel.ai_voltage_units == VoltageUnits.VOLTS and channel.ai_max == 2.0


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda o: Scale.create_lin_scale("x", 0.0, grpc_options=o), -200409),
        (lambda o: Scale.create_map_scale("x", 1.0, 1.0, 0.0, 1.0, grpc_options=o), -200602),
        (lambda o: Scale.create_map_scale("x", 0.0, 1.0, 2.0, 2.0, grpc_options=o), -200603),
        (lambda o: Scale.create_table_scale("x", [0.0, 1.0], [0.0], grpc_options=o), -200350),
        (lambda o: Scale.create_table_scale("x", [0.0], [0.0], grpc_options=o), -200434),
        (lambda o: Scale.create_table_scale("x", [0.0, 0.0], [0.0, 1.0], grpc_options=o), -200598),
        (lambda o: Scale.create_polynomial_scale("x", [0.0], [1.0], grpc_options=o), -200407),
        (lambda o: Scale("missing", grpc_options=o).lin_slope, -200378),
    ],
)
def test_scales_that_cannot_be_are_refused_with_the_drivers_code(make, code, options, refused) -> None:
    with refused(code):
        make(options)


def test_the_inverse_of_a_polynomial_is_fitted(options) -> None:
    found = Scale.calculate_reverse_poly_coeff([0.0, 2.0], -1.0, 1.0, 100, -1, grpc_options=options)
    np.testing.assert_allclose(found, [0.0, 0.5], atol=1e-12)


def test_an_index_that_is_not_wired_never_comes(card) -> None:
    task = card.task()
    channel = task.ci_channels.add_ci_ang_encoder_chan(
        "Dev1/ctr0", zidx_enable=True, zidx_val=30.0, zidx_phase=EncoderZIndexPhase.AHIGH_BLOW, initial_angle=15.0
    )
    assert channel.ci_encoder_z_index_enable and channel.ci_encoder_z_index_val == 30.0
    assert channel.ci_encoder_z_index_phase == EncoderZIndexPhase.AHIGH_BLOW
    task.start()
    assert task.read() == 15.0
