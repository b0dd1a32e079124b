"""Learning: on a plant in closed form the error falls, limits hold, what was played is what is written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rig import InputError, Profile, Timing, TrialData, learn, make_target, motor_command, parse_profile
from rig.learning.target_force import find_key_bottom
from rig.session.trial_head import TrialHead

RATE = 5000.0
BOTTOM_S = 0.12


def pianist(peak_n: float = 8.0, spike_n: float = 12.0, rest_n: float = 0.0) -> np.ndarray:
    """40 ms of rest, a smooth rise for 80 ms with a ripple, a spike at 0.12 s, held to 0.3 s, released."""
    t = np.arange(int(0.45 * RATE)) / RATE
    s = np.clip((t - 0.04) / (BOTTOM_S - 0.04), 0, 1)
    force = peak_n * (s**1.5 + 0.05 * np.sin(4 * np.pi * s) * s * (1 - s))
    force += spike_n * np.clip(1 - np.abs(t - BOTTOM_S - 0.004) / 0.004, 0, None)
    return rest_n + force * np.clip((0.4 - t) / 0.1, 0, 1)


def bench(config, *, gain: float = 0.8, lag_s: float = 0.0015, drift: float = 0.0):
    """A trial whose force is the command times a gain through a first-order lag, and a spike at key bottom."""

    def blow(profile: Profile, number: int) -> TrialData:
        command = motor_command(profile, config)
        timing = Timing(RATE, 0.00800645)
        n = command.volts.size + 1000
        time = np.arange(n) / RATE
        volts = np.concatenate((command.volts, np.zeros(1000)))
        felt, held = np.zeros(n), 0.0
        step = 1 - np.exp(-1 / (lag_s * RATE))
        for k in range(1, n):
            held += step * (gain * (1 + drift * number) * 12.0 * volts[k - 1] - held)
            felt[k] = held
        bottom = command.blow_start_s - profile.onset_s + 0.05 + (BOTTOM_S - 0.04)
        felt += 20 * np.clip(1 - np.abs(time - bottom - 0.002) / 0.002, 0, None)
        force = np.interp(time - timing.force_group_delay_s, time, felt)
        force += (
            0.15 + 0.03 * np.sin(2 * np.pi * 60 * time + number) + 0.01 * np.random.default_rng(number).normal(size=n)
        )
        head = TrialHead.from_rig(config, timing, command, number=1, simulated=True)
        return TrialData(
            1, "complete", "", True, RATE, time, force, force, volts, np.zeros((n, 3), dtype=np.int64),
            head.encoders, head.force_info, blow_start_s=command.blow_start_s,
        )  # fmt: skip

    return blow


def test_the_force_follows_within_a_few_blows_and_never_leaves_the_limits(config) -> None:
    target = make_target("pianist", pianist(), 1 / RATE, RATE)
    assert target.bottom_s == pytest.approx(0.05 + 0.08, abs=2e-3) and target.peak_n == pytest.approx(8, rel=0.03)
    played: list[Profile] = []

    def blow(profile: Profile, number: int) -> TrialData:
        played.append(profile)
        return bench(config)(profile, number)

    learned = learn(target, config, blow, blows=8, goal=0.015)
    errors = [entry.error for entry in learned.blows]
    assert learned.follows and len(errors) <= 8 and errors[0] > 0.1 > 5 * learned.best.error
    for profile in played:
        profile.check_limits(config.motor.force_limit_n, config.motor.slew_limit_n_per_s, RATE)
    # independently: what the best profile does on the noiseless plant follows the pianist
    force = learned.best.profile.sample(RATE)
    felt, held = np.zeros_like(force), 0.0
    for k in range(1, force.size):
        held += (1 - np.exp(-1 / (0.0015 * RATE))) * (0.8 * force[k - 1] - held)
        felt[k] = held
    inside = slice(int(0.05 * RATE), int(0.125 * RATE))
    error = felt[1:][inside] - target.force_n[inside]
    assert np.sqrt(np.mean(error**2)) < 0.02 * target.peak_n


def test_the_command_stops_at_the_motors_limits(edited_rig) -> None:
    config = edited_rig(("slew_limit_n_per_s = 2000.0", "slew_limit_n_per_s = 170.0"),
                        ("force_limit_n = 120.0", "force_limit_n = 8.5")).config  # fmt: skip
    target = make_target("pianist", pianist(), 1 / RATE, RATE)
    learned = learn(target, config, bench(config, gain=0.5), blows=5, goal=0.01)
    assert not learned.follows and len(learned.blows) == 5
    for entry in learned.blows:
        force = entry.profile.sample(RATE)
        assert np.abs(force).max() <= 8.5 and np.abs(np.diff(force)).max() * RATE <= 170.0 * (1 + 1e-9)
    assert learned.best.limited and "limits of force or slew rate" in learned.obstacle()


@pytest.mark.parametrize(
    ("scale", "words"),
    [(20.0, "allowed 120 N"), (14.0, "N/s before key bottom, allowed 2000 N/s"), (1e-3, "allowed from 0.667 N")],
)
def test_what_no_number_of_blows_can_reach_is_refused(config, scale: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        learn(make_target("p", pianist(), 1 / RATE, RATE, scale=scale), config, bench(config))


def test_a_let_off_faster_than_the_arm_is_named(config) -> None:
    target = make_target("pianist", pianist(), 1 / RATE, RATE)

    def blow(profile: Profile, number: int) -> TrialData:
        data = bench(config)(profile, number)
        begun = data.blow_start_s - profile.onset_s + data.force_info.group_delay_s + target.bottom_s
        dip = 6.0 * ((data.time_s > begun - 0.0012) & (data.time_s < begun))
        return replace(data, raw_force_n=data.raw_force_n - dip)

    learned = learn(target, config, blow, blows=4, goal=0.02)
    assert not learned.follows and "last 1.5 ms before key bottom" in learned.obstacle()


def test_what_is_played_is_what_the_text_says(config) -> None:
    target = make_target("pianist", pianist(), 1 / RATE, RATE)
    learned = learn(target, config, bench(config), blows=2, goal=0.001)
    again = parse_profile(learned.best.profile.text)
    np.testing.assert_array_equal(again.sample(RATE), learned.best.profile.sample(RATE))


def test_targets_from_a_slower_and_a_faster_recording_agree() -> None:
    fine = pianist()
    slow = make_target("slow", fine[::4], 4 / RATE, RATE)
    time = np.arange(fine.size * 4) / (4 * RATE)
    fast = make_target("fast", np.interp(time, np.arange(fine.size) / RATE, fine), 0.25 / RATE, RATE)
    own = make_target("own", fine, 1 / RATE, RATE)
    for other in (slow, fast):
        assert other.bottom_s == pytest.approx(own.bottom_s, abs=1.5e-3)
        before = own.time_s < 0.12
        shift = min(
            (np.abs(np.interp(own.time_s + d, other.time_s, other.force_n) - own.force_n)[before].max(), d)
            for d in np.arange(-10, 11) / RATE
        )
        assert shift[0] < 0.1


def test_scale_rest_and_key_bottom_are_taken_as_given() -> None:
    own = make_target("own", pianist(rest_n=0.3), 1 / RATE, RATE, scale=2.0, key_bottom_s=0.11)
    assert own.rest_n == pytest.approx(0.6) and own.force_n[0] == 0
    assert own.bottom_s == pytest.approx(own.onset_s + 0.11 - 0.04, abs=5e-3)


@pytest.mark.parametrize(
    ("force", "arguments", "words"),
    [
        (np.zeros(2000), {}, "does not begin with"),
        (pianist()[400:], {}, "does not begin with"),
        (pianist(spike_n=0.0), {}, "no spike at key bottom"),
        (pianist()[:100], {}, "lasts 0.02 s"),
        (pianist(), {"scale": -1.0}, "scale = -1"),
        (pianist(), {"key_bottom_s": 9.0}, "key bottom at 9 s"),
        (pianist(), {"key_bottom_s": float("nan")}, "key bottom at nan s"),
        (-pianist(), {}, "does not begin with|before a push"),
    ],
)
def test_what_is_no_blow_is_refused(force: np.ndarray, arguments: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_target("x", force, 1 / RATE, RATE, **arguments)


def test_the_first_of_two_spikes_is_key_bottom() -> None:
    force = pianist()
    force[1000:1020] += 14 * (1 - np.abs(np.arange(20) - 10) / 10)
    assert find_key_bottom(force, RATE) == pytest.approx(BOTTOM_S * RATE, abs=6)


def test_the_first_command_does_not_ring_with_the_recording() -> None:
    time = np.arange(pianist().size) / RATE
    ringing = pianist() + 0.8 * np.sin(2 * np.pi * 450 * time) * ((time > 0.1) & (time < BOTTOM_S))
    rough = make_target("ringing", ringing, 1 / RATE, RATE, key_bottom_s=BOTTOM_S)
    smooth = make_target("own", pianist(), 1 / RATE, RATE, key_bottom_s=BOTTOM_S)
    n = min(rough.command_n.size, smooth.command_n.size)
    assert np.abs(rough.force_n[:n] - smooth.force_n[:n]).max() > 0.7
    assert np.abs(rough.command_n[:n] - smooth.command_n[:n]).max() < 0.1


def test_the_spike_at_key_bottom_is_aimed_at_and_not_commanded() -> None:
    target, plain = (make_target("x", pianist(spike_n=n), 1 / RATE, RATE, key_bottom_s=BOTTOM_S) for n in (12.0, 0.0))
    assert target.force_n.max() > 18.0 > 9.0 > plain.force_n.max()
    assert np.abs(target.command_n - plain.command_n).max() < 0.3
