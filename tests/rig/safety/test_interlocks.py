"""What keeps a blow from being played, and each limit that ends one; every fault in time is in test_fault_table.py."""

from __future__ import annotations

import pytest

from rig import (
    InputError,
    LimitExceeded,
    Session,
    load_rig,
    open_backend,
)
from rig import (
    record as record_session,
)
from rig.simulated.device.faults import parse_faults
from rig.simulated.device.state import FaultPlan


@pytest.fixture
def bench(tmp_path, make_backend, rig, record_steps):
    """Record three trials with planted faults: (call, folder, backend)."""
    backend = make_backend(rig.config, noise_n=0.02)

    def call(faults: str, **changes):
        backend.device.faults = FaultPlan(parse_faults(faults))
        return record_steps(rig, backend=backend, trials=3, **changes)

    return call, tmp_path / "s", backend


@pytest.mark.parametrize("body", ["key", "whippen", "hammer"])
def test_an_encoder_that_sticks_or_loses_counts_is_found_and_named(tmp_path, body) -> None:
    rig = load_rig("virtual")
    for fault, at_s, message in (
        ("stuck", 0.3, f"{body} encoder does not move"),
        ("miscount", 0.9, f"{body} encoder rests -?0.0[01]"),
    ):
        backend = open_backend(f"sim://?fault={fault}:{body}@1/{at_s}", rig.config)
        with pytest.raises(LimitExceeded, match=f"^{message}"):
            record_session(tmp_path / fault, rig_config=rig, backend=backend, trials=2)
        (trial,) = Session.open(tmp_path / fault).trials
        assert trial.status == "fault" and body in trial.read().reason
        assert backend.device.output_v["cDAQ1Mod2/ao0"] == 0.0 and not backend.device.drive_enabled()
        backend.close()


def test_an_encoder_that_moves_before_the_blow_or_a_force_out_of_range_keeps_the_motor_still(
    bench, make_backend, rig, record_steps, tmp_path, assert_safe
) -> None:
    call, folder, backend = bench
    with pytest.raises(LimitExceeded, match="hammer encoder moved by 300 counts in the 0.2 s before the blow"):
        call("miscount:hammer@1/0.25")
    assert_safe(backend)
    data = Session.open(folder).trial(1).read()
    assert data.status == "fault" and data.time_s[-1] < data.blow_start_s and not data.motor_command_v.any()
    loaded = make_backend(rig.config, noise_n=0.02, offset_n=2.0)
    with pytest.raises(LimitExceeded, match="force 2.05 N before the blow, allowed -1 to 1 N"):
        record_steps(rig, "t", backend=loaded)
    assert not Session.open(tmp_path / "t").trial(1).read().motor_command_v.any()


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ("force_max_n = 5.0", r"force 5\.\d+ N at 0\.376\d s, allowed -10 to 5 N"),
        ("force_rate_n_per_s = 400.0", r"N/s at 0\.3[67]\d+ s, allowed 400 N/s"),
        ("speed_rad_per_s = [15.0, 40.0, 10.0]", r"hammer encoder: 1\d(\.\d+)? rad/s at 0\.361\d s, allowed 10 rad/s"),
        ("travel_rad = [0.02, 0.25, 1.2]", r"key encoder: -0\.020\d rad from rest at 0\.368\d s, allowed 0\.02 rad"),
    ],
)
def test_each_limit_stops_the_trial_where_it_is_first_exceeded(
    limit, message, edited_rig, make_backend, record_steps, tmp_path, assert_safe
) -> None:
    rig = edited_rig(("[limits]\nleast_preload_n = 0.02 ", f"[limits]\n{limit}\n# "))
    backend = make_backend(rig.config, noise_n=0.001)
    with pytest.raises(LimitExceeded, match=message):
        record_steps(rig, backend=backend)
    assert_safe(backend)
    assert Session.open(tmp_path / "s").trials[0].status == "fault"


def test_a_profile_that_heats_the_motor_is_refused_before_anything_moves(bench, tmp_path, edited_rig) -> None:
    call, folder, backend = bench
    limited = edited_rig(("[motor]", "[motor]\nrms_force_limit_n = 0.3\nrms_over_s = 1.0"))
    # 6 N for 50 ms and two flanks of 10 ms: sqrt(36 * (0.05 + 0.02 / 3)) N over 1 s
    with pytest.raises(InputError, match="RMS force 1.43 N over 1 s heats the motor, allowed 0.3 N"):
        call("", rig_config=limited)
    assert not folder.exists() and backend.service.trace == []


@pytest.mark.parametrize("text", ["late@1/0.4", "overwrite", "stuck@1/0.4", "stuck:jack@1/0.4", "overwrite@1/x"])
def test_a_fault_that_cannot_be_planted_is_one_line(text) -> None:
    with pytest.raises(InputError, match="fault .*write") as refusal:
        open_backend(f"sim://?fault={text.replace('#', '%23')}", load_rig("virtual").config)
    assert "\n" not in str(refusal.value)
