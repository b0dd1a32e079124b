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

from rig.configuration.rig_file import load_rig
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


def test_an_open_thermocouple_input_reads_the_cold_junction(card: Any) -> None:
    task = card.task()
    channel = task.ai_channels.add_ai_thrmcpl_chan(
        "Dev1/ai2", units=ni.TemperatureUnits.DEG_F, thermocouple_type=ni.ThermocoupleType.T, cjc_val=22.0
    )
    assert channel.ai_thrmcpl_type == ni.ThermocoupleType.T and channel.ai_thrmcpl_cjc_val == 22.0
    assert channel.ai_meas_type == ni.UsageTypeAI.TEMPERATURE_THERMOCOUPLE
    assert task.read() == pytest.approx(22.0 * 1.8 + 32.0, abs=0.2)  # a step of the converter is 3 uV, 0.14 deg F
    with pytest.raises(DaqError) as refused:
        card.task().ai_channels.add_ai_thrmcpl_chan("Dev1/ai3", cjc_source=ni.CJCSource.BUILT_IN)
    assert refused.value.error_code == -200576


def logged(card: Any, path: str, mode: ni.LoggingMode) -> nidaqmx.Task:
    task = card.task("logged")
    task.ai_channels.add_ai_voltage_chan("Dev1/ai1")
    task.ai_channels.add_ai_voltage_chan("Dev1/ai2")
    task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=50)
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
    clock, pulses, measured = card.task(), card.task(), card.task()
    clock.co_channels.add_co_pulse_chan_freq("Dev1/ctr1", freq=10.0, initial_delay=0.1)  # on PFI13
    clock.timing.cfg_implicit_timing(sample_mode=CONTINUOUS)
    channel = pulses.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=1000.0)  # on PFI12
    pulses.timing.cfg_samp_clk_timing(10.0, "/Dev1/PFI13", sample_mode=CONTINUOUS)
    pulses.out_stream.output_buf_size = 3
    pulses.write([CtrFreq(1000.0, 0.5), CtrFreq(500.0, 0.25), CtrFreq(250.0, 0.75)])
    assert pulses.timing.samp_timing_type == ni.SampleTimingType.SAMPLE_CLOCK
    measured.ai_channels.add_ai_voltage_chan("Dev1/ai1")
    measured.timing.cfg_samp_clk_timing(10_000.0, sample_mode=CONTINUOUS, samps_per_chan=10_000)
    for task in (measured, pulses, clock):
        task.start()
    seen = []
    for _ in range(4):
        measured.read(900, timeout=1.0)
        seen.append((round(channel.co_pulse_freq), round(channel.co_pulse_duty_cyc, 2)))
        measured.read(100, timeout=1.0)
    assert seen == [(1000, 0.5), (500, 0.25), (250, 0.75), (1000, 0.5)]


def test_an_encoder_reads_in_a_scale_of_the_labs_own(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
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


def test_a_frequency_reads_in_a_scale_of_the_labs_own(card: Any) -> None:
    options = nidaqmx.GrpcSessionOptions(card._channel, "")
    hertz, litres = [0.0, 100.0, 1000.0], [0.0, 1.0, 20.0]
    Scale.create_table_scale("flow", hertz, litres, ni.UnitsPreScaled.HERTZ, grpc_options=options)
    train, counted = card.task(), card.task()
    train.co_channels.add_co_pulse_chan_freq("Dev1/ctr0", freq=550.0)
    train.timing.cfg_implicit_timing(sample_mode=CONTINUOUS)
    train.start()
    counted.ci_channels.add_ci_freq_chan(
        "Dev1/ctr1", min_val=0.1, max_val=20.0, units=ni.FrequencyUnits.FROM_CUSTOM_SCALE, custom_scale_name="flow"
    ).ci_freq_term = "/Dev1/PFI12"
    assert counted.read() == pytest.approx(10.5, rel=1e-4)


@pytest.fixture
def bench(make_backend) -> Any:
    return make_backend(load_rig("pcie6363").config)


@pytest.fixture
def options(bench) -> GrpcSessionOptions:
    return GrpcSessionOptions(bench._channel, "")


def looped(bench: Any, scale_in: str, scale_out: str, written: list[float], limits: tuple[float, float]) -> list[float]:
    """Write on demand, in one scale or in volts, to the output that ``ai1`` is wired to; read in the other."""

    def options(name: str) -> GrpcSessionOptions:
        return GrpcSessionOptions(bench._channel, name)

    scaled = VoltageUnits.FROM_CUSTOM_SCALE
    out, back = nidaqmx.Task("out", grpc_options=options("out")), nidaqmx.Task("in", grpc_options=options("in"))
    with out, back:
        kind = {"units": scaled, "custom_scale_name": scale_out} if scale_out else {}
        out.ao_channels.add_ao_voltage_chan("Dev1/ao0", min_val=limits[0], max_val=limits[1], **kind)
        kind = {"units": scaled, "custom_scale_name": scale_in} if scale_in else {}
        back.ai_channels.add_ai_voltage_chan("Dev1/ai1", min_val=limits[0], max_val=limits[1], **kind)
        read = []
        for value in written:
            out.write(value)
            read.append(back.read())
    return read


def test_each_scale_reads_in_its_unit(bench, options) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, scaled_units="N", grpc_options=options)
    Scale.create_map_scale("percent", -10.0, 10.0, 0.0, 100.0, grpc_options=options)
    Scale.create_table_scale("table", [0.0, 4.0, 1.0], [0.0, 10.0, 1.0], grpc_options=options)
    Scale.create_polynomial_scale("square", [0.0, 1.0, 0.5], [0.0, 1.0], grpc_options=options)
    volts = [-2.0, 0.0, 0.5, 2.5, 5.0]
    step = 10 / 2**15
    rules = {
        "newtons": (lambda v: 12 * v - 3, 12.0),
        "percent": (lambda v: 50 + 5 * v, 5.0),
        "TABLE": (lambda v: np.interp(v, [0, 1, 4], [0, 1, 10]), 3.0),
        "square": (lambda v: v + 0.5 * v * v, 6.0),
    }
    for name, (rule, slope) in rules.items():
        plain = nidaqmx.Task("out2", grpc_options=GrpcSessionOptions(bench._channel, "out2"))
        back = nidaqmx.Task("in2", grpc_options=GrpcSessionOptions(bench._channel, "in2"))
        with plain, back:
            plain.ao_channels.add_ao_voltage_chan("Dev1/ao0")
            back.ai_channels.add_ai_voltage_chan(
                "Dev1/ai1", min_val=0.0, max_val=5.0, units=VoltageUnits.FROM_CUSTOM_SCALE, custom_scale_name=name
            )
            channel = back.ai_channels[0]
            channel.ai_rng_high, channel.ai_rng_low = 10.0, -10.0
            for v in volts:
                plain.write(v)
                assert back.read() == pytest.approx(float(rule(v)), abs=2 * step * slope)


def test_what_is_written_in_a_scale_is_read_in_it(bench, options) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, grpc_options=options)
    written = [-20.0, 0.0, 7.5, 50.0]
    np.testing.assert_allclose(
        looped(bench, "newtons", "newtons", written, (-60.0, 60.0)), written, atol=12 * 10 / 2**14
    )
    assert bench.device.output_v["Dev1/ao0"] == pytest.approx((50.0 + 3.0) / 12.0)


def test_a_value_beyond_the_outputs_volts_is_refused(bench, options) -> None:
    Scale.create_lin_scale("newtons", 12.0, -3.0, grpc_options=options)
    with pytest.raises(nidaqmx.errors.DaqError) as refused:
        looped(bench, "newtons", "newtons", [0.0], (-200.0, 200.0))  # 16.9 V
    assert refused.value.error_code == -200077
    with pytest.raises(nidaqmx.errors.DaqError) as refused:
        looped(bench, "newtons", "newtons", [61.0], (-60.0, 60.0))
    assert refused.value.error_code == -200561


def test_properties_are_those_it_was_made_with_and_can_be_changed(bench, options) -> None:
    scale = Scale.create_lin_scale("a", 2.0, 0.5, UnitsPreScaled.VOLTS, "N", grpc_options=options)
    assert (scale.lin_slope, scale.lin_y_intercept, scale.scaled_units, scale.description) == (2.0, 0.5, "N", "")
    scale.lin_slope, scale.description = 4.0, "of the cell"
    assert (scale.lin_slope, scale.description) == (4.0, "of the cell")
    for ask in (lambda: scale.table_scaled_vals, lambda: setattr(scale, "lin_slope", 0.0)):
        with pytest.raises(nidaqmx.errors.DaqError):
            ask()
    assert scale.lin_slope == 4.0
    with nidaqmx.Task("t", grpc_options=GrpcSessionOptions(bench._channel, "t")) as task:
        task.ai_channels.add_ai_voltage_chan(
            "Dev1/ai0", min_val=-5.0, max_val=5.0, units=VoltageUnits.FROM_CUSTOM_SCALE, custom_scale_name="a"
        )
        channel = task.ai_channels[0]
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
def test_scales_that_cannot_be_are_refused_with_the_drivers_code(make, code, options) -> None:
    with pytest.raises(nidaqmx.errors.DaqError) as refused:
        make(options)
    assert refused.value.error_code == code


def test_the_inverse_of_a_polynomial_is_fitted(options) -> None:
    found = Scale.calculate_reverse_poly_coeff([0.0, 2.0], -1.0, 1.0, 100, -1, grpc_options=options)
    np.testing.assert_allclose(found, [0.0, 0.5], atol=1e-12)


def test_an_index_that_is_not_wired_never_comes(bench) -> None:
    with nidaqmx.Task("z", grpc_options=GrpcSessionOptions(bench._channel, "z")) as task:
        channel = task.ci_channels.add_ci_ang_encoder_chan(
            "Dev1/ctr0", zidx_enable=True, zidx_val=30.0, zidx_phase=EncoderZIndexPhase.AHIGH_BLOW, initial_angle=15.0
        )
        assert channel.ci_encoder_z_index_enable and channel.ci_encoder_z_index_val == 30.0
        assert channel.ci_encoder_z_index_phase == EncoderZIndexPhase.AHIGH_BLOW
        task.start()
        assert task.read() == 15.0
