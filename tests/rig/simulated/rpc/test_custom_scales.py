"""Custom scales of NI's client on the virtual device: what is measured, in the lab's own unit, and back for outputs."""

from __future__ import annotations

from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx import GrpcSessionOptions, Scale
from nidaqmx.constants import EncoderZIndexPhase, UnitsPreScaled, VoltageUnits

from rig.configuration.rig_file import load_rig


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
