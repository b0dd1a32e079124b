"""A small recorded session made from the model itself with known truth: known offset, hum, delay, scatter,
film angles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

RATE_HZ = 5000.0
LENGTH_S = 1.35
BLOW_S = 0.40
GROUP_DELAY_S = 0.0024
PRELOAD_N = 0.05
OFFSETS_N = (0.31, -0.22, 0.12, 0.4, -0.05)
STRENGTH = (1.0, 1.012, 0.991, 1.006, 0.996)
HUM_N = (0.25, 0.0, 0.08)
HUM_HZ = 60.07
NOISE_N = 0.01
SPECIMEN = {"contact04.friction.A": 0.6}


def forte_n(time_s, strength=1.0, onset_s=BLOW_S):
    """A forte blow: slow rise to 10 N, a spike when the key reaches its bottom, a hold and a release."""
    t = np.asarray(time_s) - onset_s
    rise = 10 * np.clip(t / 0.06, 0, 1) ** 1.5
    spike = 23 * np.clip(1 - np.abs(t - 0.0625) / 0.003, 0, 1)
    release = 0.5 * (1 + np.cos(np.pi * np.clip((t - 0.26) / 0.1, 0, 1)))
    return strength * (rise + spike) * release


@dataclass
class Truth:
    """What the synthetic bench knows and validation must find again."""

    time_s: np.ndarray
    angle_rad: dict
    speed_rad_per_s: dict
    force_n: dict
    rest_rad: np.ndarray
    action: object
    specimen: object


def session_info(**changes):
    from rig import SessionInfo
    from rig.session.info import FileInfo

    values = {
        "simulated": True,
        "name": "test forte",
        "operator": "tester",
        "rig": FileInfo(name="rig.toml"),
        "profile": FileInfo(name="forte"),
    } | changes
    return SessionInfo(**values)


def trial_data(number, time_s, force_n, change_rad, *, status="complete", camera=None, reason="", names=None):
    """A recorded trial from true force (at the sample times) and true angle changes of three bodies."""
    from rig import EncoderInfo, ForceInfo, TrialData

    rng = np.random.default_rng(1000 + number)
    # sample i of the channel shows the force of one group delay earlier
    delayed = np.interp(time_s - GROUP_DELAY_S, time_s, force_n, left=force_n[0])
    hum = sum(a * np.cos(2 * np.pi * k * HUM_HZ * time_s + 0.4 * k) for k, a in enumerate(HUM_N, start=1))
    offset = OFFSETS_N[(number - 1) % len(OFFSETS_N)] - PRELOAD_N
    reading = delayed + offset + hum + rng.normal(0, NOISE_N, time_s.size)
    counts_per_revolution = (327_680, 163_840, 163_840)
    signs = (1, -1, 1)
    encoders, counts = [], []
    for i, name in enumerate(names or ("key", "whippen", "hammer")):
        info = EncoderInfo(name, counts_per_revolution[i], signs[i])
        phase = rng.uniform()
        raw = np.floor(change_rad[:, i] / info.rad_per_count + phase).astype(np.int64)
        encoders.append(info)
        counts.append(raw - raw[0])
    force_info = ForceInfo(
        "load cell", "test", (0.0, 1.0), (0.0, 50.0), group_delay_s=GROUP_DELAY_S, u_noise_n=NOISE_N,
        u_gain_relative=0.002, preload_n=PRELOAD_N, u_preload_n=0.005, mains_frequency_hz=60.0,
    )  # fmt: skip
    return TrialData(
        number=number, status=status, reason=reason, started_utc="2026-11-21T08:00:00Z", simulated=True,
        sample_rate_hz=RATE_HZ, time_s=time_s, raw_force_n=reading, force_raw=reading / 50.0,
        motor_command_v=np.zeros(time_s.size), encoder_count=np.column_stack(counts),
        encoders=tuple(encoders), force_info=force_info, camera=camera, blow_start_s=BLOW_S,
    )  # fmt: skip


@cache
def rest_of_specimen():
    """The specimen at rest under the preload."""
    import model

    specimen = model.load_action("hirschkorn2004", SPECIMEN)
    return specimen, model.rest_state(specimen, force_n=PRELOAD_N)


@cache
def motion_of_specimen(strength):
    """Force of a blow at the sample times and how the specimen moves under it, computed once in a process."""
    import model

    specimen, rest = rest_of_specimen()
    time = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ
    force = PRELOAD_N + forte_n(time, strength)
    return force, model.simulate(specimen, time, force, initial=rest)


def play(action, strength=1.0):
    """Times, force and encoder angles of a blow on an action, as `trial_data` takes them."""
    import model

    rest = model.rest_state(action, force_n=PRELOAD_N)
    time = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ
    force = PRELOAD_N + forte_n(time, strength)
    return time, force, (model.simulate(action, time, force, initial=rest).angle_rad - rest.angle_rad)[:, [0, 1, 4]]


def make_session(folder: Path, n_trials=5, filmed=(2,), strength=STRENGTH, **info):
    """Create a session on disk whose specimen differs from the model in friction; return it with truth."""
    import model
    from rig import CameraInfo, Session

    action = model.load_action("hirschkorn2004")
    specimen, rest = rest_of_specimen()
    session = Session.create(folder, session_info(**info))
    time = np.arange(int(LENGTH_S * RATE_HZ)) / RATE_HZ
    truth = Truth(time, {}, {}, {}, rest.angle_rad, action, specimen)
    for number in range(1, n_trials + 1):
        force, solution = motion_of_specimen(strength[(number - 1) % len(strength)])
        truth.angle_rad[number] = solution.angle_rad
        truth.speed_rad_per_s[number] = solution.speed_rad_per_s
        truth.force_n[number] = force
        change = (solution.angle_rad - rest.angle_rad)[:, [0, 1, 4]]
        camera = CameraInfo(2000.0, 0.3001, 1e-4, 1600, 2e-6) if number in filmed else None
        session.add_trial(trial_data(number, time, force, change, camera=camera))
        if camera is not None:
            session.write_derived("angles", number, film_table(camera, solution, rest))
    return session, truth


def film_table(camera, solution, rest, noise_rad=4e-4, lost=(700, 701, 702)):
    """Tracked angles as `vision` gives them: noise as stated, three lost frames."""
    rng = np.random.default_rng(7)
    time = camera.frame_time_s
    columns = {"time_s": time, "frame": np.arange(time.size)}
    for body, i in (("jack", 2), ("repetition", 3)):
        angle = np.interp(time, solution.time_s, solution.angle_rad[:, i]) - rest.angle_rad[i]
        angle += rng.normal(0, noise_rad, time.size)
        angle[list(lost)] = np.nan
        columns[f"{body}_relative_rad"] = angle
        columns[f"{body}_relative_u_rad"] = np.full(time.size, noise_rad)
    return pd.DataFrame(columns)


@pytest.fixture(scope="session")
def recorded(shared):
    """Five trials on disk, the second one filmed, and their truth; read only."""
    from rig import Session

    def make(folder):
        session, truth = make_session(folder / "forte")
        return session.path, truth

    path, truth = shared(make)
    return Session.open(path), truth


@pytest.fixture(scope="session")
def compared(recorded, shared):
    """The comparison of the recorded session; predictions are not kept on disk."""
    from validation import compare as compare_session

    return shared(lambda folder: compare_session(recorded[0], recorded[1].action, keep_predictions=False, further=True))


@pytest.fixture(scope="session")
def planted(shared):
    """The comparison of the shipped session with planted faults."""
    from validation import compare as compare_session

    shipped = Path(__file__).parents[2] / "sessions" / "planted_faults"
    options = {"keep_predictions": False, "rivals": (), "budget": False}
    # effects that the model has not compile half a minute: slow tests of findings try them
    return shared(lambda folder: compare_session(shipped, explain=True, effects=False, **options))


@pytest.fixture
def fewer_draws(monkeypatch):
    """As many as an interval needs."""
    monkeypatch.setattr("validation.verdict.error_draws.DRAWS", 99)


@pytest.fixture(scope="session")
def written(compared, shared):
    """The report of the comparison, written once."""
    from validation import write_report

    return shared(lambda folder: write_report(compared, folder))


HOSTILE = 'recalibrated $\\frac{ <b> & "quoted" ' + "x" * 120


@pytest.fixture(scope="session")
def side(compared):
    """Two sessions and two models, of one comparison: other names, the second model's errors half as large again."""
    from validation.side_by_side import SideBySide

    def other(session, model, factor):
        columns = [c for c in compared.scores.columns if c.endswith("rmse_rad")]
        scores = compared.scores.assign(**{c: compared.scores[c] * factor for c in columns})
        drawn = [c for c in columns if c in compared.nuisance]
        changed = {
            "tables": {**compared.tables, "scores": scores},
            "nuisance": compared.nuisance.assign(**{c: compared.nuisance[c] * factor for c in drawn}),
            "traces": {number: compared.traces[number] for number in (1, 2)},  # curves cost most of the drawing
        }
        return replace(compared, session_name=session, action_name=model, motion_trace=None, **changed)

    results = tuple(
        other(session, model, factor)
        for session in ("blow piano", "double </script><img src=x onerror=alert(1)>")
        for model, factor in (("calibrated", 1.0), (HOSTILE, 1.5))
    )
    return SideBySide(results, ("nowhere: no such session folder",))


@pytest.fixture(scope="session")
def side_written(side, shared):
    """The report of two sessions and two models, written once."""
    from validation import write_report

    return shared(lambda folder: write_report(side, folder))


@pytest.fixture(scope="session")
def make():
    """The builders of this file, for tests that need other sessions."""
    return SimpleNamespace(
        session=make_session, trial=trial_data, play=play, info=session_info, force=forte_n, film=film_table,
        rate_hz=RATE_HZ, group_delay_s=GROUP_DELAY_S, preload_n=PRELOAD_N, offsets_n=OFFSETS_N, hum_n=HUM_N,
        hum_hz=HUM_HZ, noise_n=NOISE_N, blow_s=BLOW_S,
    )  # fmt: skip
