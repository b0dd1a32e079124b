"""Profiles: the built-in ones are what the thesis describes; bad ones are refused; interpolation against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from rig import InputError, load_profile, parse_profile
from rig.configuration.profile import built_in_profiles
from rig.configuration.toml_file import dump_toml

LIMITS = (120.0, 2000.0)


def profile_text(points: list[tuple[float, float]], interpolation: str = "linear") -> str:
    rows = [{"time_s": t, "force_n": f} for t, f in points]
    return dump_toml({"name": "p", "interpolation": interpolation, "points": rows})


def test_the_three_built_in_profiles_are_within_the_limits_and_end_at_zero() -> None:
    assert built_in_profiles() == ("double", "forte", "piano")
    for name in built_in_profiles():
        profile = load_profile(name)
        profile.check_limits(*LIMITS)
        samples = profile.sample(5000.0)
        assert samples[0] == 0.0 and samples[-1] == 0.0
        assert samples.size == round(profile.duration_s * 5000) + 1


def test_forte_rises_from_0_05_s_to_10_newton_at_0_11_s_and_is_back_at_0_40_s() -> None:
    forte = load_profile("forte")
    assert forte.onset_s == 0.05
    assert forte.force_at([0.05, 0.11, 0.31, 0.40]) == pytest.approx([0, 10, 10, 0])
    assert np.all(np.diff(forte.force_at(np.linspace(0.05, 0.11, 50))) > 0)


def test_double_strikes_twice_0_20_s_apart_the_first_held_0_05_s_and_released_in_0_03_s() -> None:
    double = load_profile("double")
    time_s = np.arange(0, double.duration_s, 1e-4)
    force = double.force_at(time_s)
    peak = force.max()
    onsets = time_s[np.flatnonzero((force[:-1] == 0) & (force[1:] > 0))]
    assert onsets == pytest.approx([0.05, 0.25], abs=2e-4)
    held = time_s[(force >= peak - 1e-9) & (time_s < 0.25)]
    assert held[-1] - held[0] == pytest.approx(0.05, abs=2e-4)
    back = time_s[(force == 0) & (time_s > held[-1])][0]
    assert back - held[-1] == pytest.approx(0.03, abs=2e-4)


def test_the_monotone_cubic_is_the_one_of_scipy() -> None:
    points = [(0.0, 0.0), (0.05, 0.0), (0.06, 0.4), (0.1, 7.3), (0.11, 10.0), (0.3, 10.0), (0.4, 2.0), (0.45, 0.0)]
    profile = parse_profile(profile_text(points, "pchip"))
    wanted = np.linspace(0, 0.45, 1001)
    reference = PchipInterpolator(*np.array(points).T)(wanted)
    assert profile.force_at(wanted) == pytest.approx(reference, abs=1e-12)
    assert profile.force_at([-0.1, 0.5]) == pytest.approx([0, 0])


ordered = st.lists(st.integers(1, 50_000), min_size=2, max_size=20, unique=True).map(sorted)


@given(ordered, st.data(), st.sampled_from(["linear", "pchip"]))
def test_what_is_written_is_read_back_and_passes_through_its_key_points(ticks, data, kind) -> None:
    forces = [0.0, *data.draw(st.lists(st.floats(-120, 120), min_size=len(ticks) - 2, max_size=len(ticks) - 2)), 0.0]
    points = [(tick / 1000, force) for tick, force in zip(ticks, forces, strict=True)]
    profile = parse_profile(profile_text(points, kind))
    assert list(zip(profile.time_s, profile.force_n, strict=True)) == points
    assert profile.force_at(profile.time_s) == pytest.approx(profile.force_n, abs=1e-9)
    dense = profile.force_at(np.linspace(profile.time_s[0], profile.time_s[-1], 300))
    assert dense.min() >= min(forces) - 1e-9 and dense.max() <= max(forces) + 1e-9


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0, 0), (0.1, 1), (0.1, 2), (0.2, 0)], "points[1] and points[2] are both at time_s = 0.1 s"),
        ([(0, 0), (0.2, 1), (0.1, 0)], "points[2].time_s = 0.1 s, allowed above points[1].time_s = 0.2 s"),
        ([(0, 0), (0.1, float("nan")), (0.2, 0)], "points[1].force_n = nan"),
        ([(0, 0), (float("inf"), 0)], "points[1].time_s = inf"),
        ([(-0.1, 0), (0.2, 0)], "points[0].time_s = -0.1"),
        ([(0, 0), (0.1, 5)], "points[1].force_n = 5 N, allowed 0: a profile must end at zero"),
        ([(0, 3), (0.1, 0)], "points[0].force_n = 3 N, allowed 0: a profile must start at zero"),
        ([(0, 0)], "points"),
        ([(0, 0), (1e9, 0)], "points[1].time_s = 1000000000"),
    ],
)
def test_bad_key_points_are_refused_with_file_key_and_value(points, said) -> None:
    with pytest.raises(InputError) as refusal:
        parse_profile(profile_text(points), "bad.toml")
    message = str(refusal.value)
    assert message.startswith("bad.toml: ") and said in message and "\n" not in message
    assert refusal.value.exit_code == 2


def test_limits_of_force_and_slew_name_value_and_limit() -> None:
    strong = parse_profile(profile_text([(0, 0), (0.1, 130), (0.2, 0)]), "strong.toml")
    with pytest.raises(InputError, match=r"points\[1\].force_n = 130 N, allowed -120 to 120 N"):
        strong.check_limits(*LIMITS)
    steep = parse_profile(profile_text([(0, 0), (0.001, 10), (0.2, 0)]), "steep.toml")
    with pytest.raises(InputError, match=r"changes by 1e\+04 N/s .* allowed 2000 N/s"):
        steep.check_limits(*LIMITS)
    steep.check_limits(120.0, 10_000.0)
    short = parse_profile(
        profile_text([(0, 0), (0.1, 0), (0.10005, 8), (0.1001, 0), (0.2, 0.5), (0.3, 0)]), "short.toml"
    )
    with pytest.raises(InputError, match=r"8 N of points\[2\] lie between two samples"):
        short.check_limits(*LIMITS)


def test_an_unknown_name_and_an_unreadable_path_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="built in are double, forte, piano"):
        load_profile("fortissimo")
    file = tmp_path / "p.toml"
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        load_profile(file)
