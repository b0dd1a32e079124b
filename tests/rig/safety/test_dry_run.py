"""The dry run: closed forms for the arm without a key, every limit refused by name, figures kept in the session."""

from __future__ import annotations

import numpy as np
import pytest

from pianorig.workflows import predictor
from rig import InputError, PredictedBlow, dry_run, load_profile, load_rig, parse_profile
from rig import record as record_session
from rig.safety.dry_run import free_arm

RATE = 5000.0


def still(profile, **changes) -> PredictedBlow:
    """A blow in which nothing moves, but for what is asked for, at sample 7."""
    n = 20
    arrays = {"force_n": np.zeros(n), "angle_rad": np.full((n, 3), 0.2), "speed_rad_per_s": np.zeros((n, 3))}
    for name, (where, value) in changes.items():
        arrays[name][where] += value
    return PredictedBlow(np.arange(n) / RATE, model="still", **arrays)


def test_an_arm_without_a_key_gains_what_the_constant_force_works_on_its_way(rig) -> None:
    arm = rig.config.arm
    fastest, energy_j = free_arm(arm, np.full(5000, 10.0), RATE)
    work_j = 10.0 * arm.length_m * arm.free_travel_rad
    assert energy_j == pytest.approx(work_j, rel=1e-9)
    assert fastest == pytest.approx(np.sqrt(2 * work_j / arm.inertia_kg_m2), rel=1e-9)
    # a pulse too short to reach the stop: impulse over inertia, whichever way it pushes
    for sign in (1, -1):
        pulse = np.concatenate((np.full(10, sign * 2.0), np.zeros(20)))
        impulse = 2.0 * arm.length_m * 10 / RATE
        assert free_arm(arm, pulse, RATE)[0] == pytest.approx(impulse / arm.inertia_kg_m2, rel=1e-12)
    # pushed and pulled back: the largest speed is in between
    both = np.concatenate((np.full(10, 2.0), np.full(10, -2.0)))
    assert free_arm(arm, both, RATE)[0] == pytest.approx(impulse / arm.inertia_kg_m2, rel=1e-12)
    assert free_arm(arm, np.zeros(9), RATE)[1] == 0.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"force_n": (7, 111.0)}, "force 111 N at 0.0014 s, allowed 110 N"),
        ({"force_n": (7, 60.0)}, "rate of force 3e.05 N/s at 0.0012 s, allowed 2.5e.05 N/s"),
        ({"angle_rad": ((7, 0), -0.13)}, "travel of the key 0.13 rad at 0.0014 s, allowed 0.12 rad"),
        ({"angle_rad": ((7, 1), 0.26)}, "travel of the whippen 0.26 rad"),
        ({"speed_rad_per_s": ((7, 2), -101.0)}, "speed of the hammer 101 rad/s at 0.0014 s, allowed 100 rad/s"),
        ({"speed_rad_per_s": ((7, 2), np.nan)}, "not finite"),
    ],
)
def test_each_limit_refuses_the_prediction_that_exceeds_it_by_name(change, said, rig, step_profile) -> None:
    with pytest.raises(InputError, match=f"step.toml: dry run: .*{said}") as refusal:
        dry_run(step_profile, rig.config, lambda profile: still(profile, **change))
    assert "\n" not in str(refusal.value)


def test_pulses_faster_than_the_input_takes_them_are_refused(edited_rig, step_profile) -> None:
    slow = edited_rig(("max_pulse_rate_hz = 1.0e6", "max_pulse_rate_hz = 1.0e5"))
    # 40,960 pulses per revolution: 100 kHz is 15.34 rad/s
    calm = {"speed_rad_per_s": ((7, 2), 15.3)}
    assert dry_run(step_profile, slow.config, lambda p: still(p, **calm))["hammer_pulse_rate_hz"] == pytest.approx(
        15.3 * 40960 / (2 * np.pi), rel=1e-6
    )
    with pytest.raises(InputError, match=r"pulse rate of the hammer encoder 1.004e\+05 Hz"):
        dry_run(step_profile, slow.config, lambda p: still(p, speed_rad_per_s=((7, 2), 15.4)))
    filtered = slow.config.encoders[0].model_copy(update={"filter_min_pulse_s": 1e-4})
    assert filtered.greatest_speed_rad_per_s == pytest.approx(5000 * 2 * np.pi / 81920)


def test_an_arm_too_fast_without_a_key_or_a_rig_without_an_arm_is_refused(edited_rig, rig, step_profile) -> None:
    weak = edited_rig(("free_energy_limit_j = 1.0", "free_energy_limit_j = 0.01"))
    with pytest.raises(InputError, match="energy of the arm without a key .* J, allowed 0.01 J"):
        dry_run(step_profile, weak.config, still)
    bare = rig.config.model_copy(update={"arm": None})
    with pytest.raises(InputError, match=r"add \[arm\] to the rig file"):
        dry_run(step_profile, bare, still)


def test_the_model_predicts_the_virtual_bench_and_a_violent_profile_never_starts(tmp_path) -> None:
    rig = load_rig("virtual")
    figures = dry_run(load_profile("forte"), rig.config, predictor(rig))
    assert figures["force_n"] == pytest.approx(33.9, abs=0.5)
    assert figures["hammer_speed_rad_per_s"] == pytest.approx(18.2, abs=0.5)
    rows = ", ".join(f"{{time_s={t},force_n={f}}}" for t, f in ((0, 0), (0.06, 118), (0.1, 118), (0.2, 0)))
    violent = parse_profile(f'name="violent"\npoints=[{rows}]', "violent.toml")
    with pytest.raises(InputError, match="violent.toml: dry run: force 119.* N at"):
        record_session(tmp_path / "s", profile=violent, rig_config=rig, predict=predictor(rig), trials=1)
    assert not (tmp_path / "s").exists()


def test_what_was_predicted_stands_in_the_session(tmp_path, rig, step_profile, record_steps) -> None:
    asked = []

    def predict(profile):
        asked.append(profile.sha256)
        return still(profile, force_n=(7, 3.5))

    session = record_steps(rig, trials=2, predict=predict)
    assert asked == [step_profile.sha256]
    assert session.info.dry_run["force_n"] == 3.5
    assert session.info.dry_run["profile_sha256"] == step_profile.sha256
    assert type(session).open(tmp_path / "s").info.dry_run == session.info.dry_run
