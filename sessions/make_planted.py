"""Make `sessions/planted_faults`: nine short blows on a simulated bench, each with one known fault; and its clean twin.

Run:  python sessions/make_planted.py [FOLDER]

The session is what a report must see through; `planted_faults` holds what is planted where.  The specimen is the printed
action with more friction in the key's joint; everything else comes from one seed.  Trials are short so that the session
stays small.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import model
from rig.session import CameraInfo, EncoderInfo, ForceInfo, Session, SessionInfo, TrialData
from rig.session.info import FileInfo

SEED = 20041
RATE_HZ = 5000.0
LENGTH_S = 0.78
BLOW_S = 0.14
PRELOAD_N = 0.05
GROUP_DELAY_S = 0.0024
STARTED = "2026-11-21T09:00:00Z"
SCALE_RADIUS_M = 0.02608
FRICTION = ("key.joint_friction.A", 2.5)
# kind of finding → trials, channels and what was planted
PLANTED: dict[int, str] = {
    2: "sign flip",
    3: "swapped channels",
    4: "film time offset",
    5: "hum",
    6: "capstan gap",
    7: "stroke of its own",
    8: "sample rate",
    9: "sample rate",
}
RATES = {8: 4000.0, 9: 2500.0}
CAMERA_LATE_S = 1e-3
HUM_N = 0.5
LIFT_M, LIFT_AT_S, LIFT_S = 0.3e-3, BLOW_S + 0.15, 6e-3


def blow_n(time_s: np.ndarray, strength: float, late_s: float = 0.0) -> np.ndarray:
    """A forte blow: rise to 10 N, spike at key bottom, short hold, release; N."""
    t = time_s - BLOW_S - late_s
    rise = 10 * np.clip(t / 0.06, 0, 1) ** 1.5
    spike = 23 * np.clip(1 - np.abs(t - 0.0625) / 0.003, 0, 1)
    return PRELOAD_N + strength * (rise + spike) * 0.5 * (1 + np.cos(np.pi * np.clip((t - 0.22) / 0.08, 0, 1)))


def record_trial(number: int, specimen: model.Action, fault: str | None) -> tuple[TrialData, pd.DataFrame | None]:
    """One trial with its fault, and its film angles where it was filmed."""
    random = np.random.default_rng([SEED, number])
    rate = RATES.get(number, RATE_HZ) if fault == "sample rate" else RATE_HZ
    time = np.arange(int(LENGTH_S * rate)) / rate
    bad = fault == "stroke of its own"
    force = blow_n(time, (0.7 if bad else 1.0) * (1 + 0.005 * random.standard_normal()), 0.012 if bad else 0.0)
    rest = model.rest_state(specimen, force_n=PRELOAD_N)
    run = model.simulate(specimen, time, force, initial=rest)
    change = (run.angle_rad - rest.angle_rad)[:, [0, 1, 4]]
    if fault == "capstan gap":
        lift = LIFT_M * np.sin(np.pi * np.clip((time - LIFT_AT_S) / LIFT_S, 0, 1))
        change[:, 0] += lift / SCALE_RADIUS_M
    if fault == "sign flip":
        change[:, 2] *= -1
    if fault == "swapped channels":
        change = change[:, [1, 0, 2]]
    encoders = (EncoderInfo("key", 327_680, 1), EncoderInfo("whippen", 327_680, 1), EncoderInfo("hammer", 163_840, -1))
    counts = [
        np.floor(change[:, i] / e.rad_per_count + random.uniform()).astype(np.int64) for i, e in enumerate(encoders)
    ]
    reading = np.interp(time - GROUP_DELAY_S, time, force) + random.normal(0.1, 0.02)
    reading += random.normal(0, 0.01, time.size)
    if fault == "hum":
        reading += HUM_N * np.cos(2 * np.pi * 60.04 * time + 1.0)
    camera = table = None
    if number == 4:
        late = CAMERA_LATE_S if fault == "film time offset" else 0.0
        camera = CameraInfo(2000.0, 0.0301, 1e-4, 1450, 2e-6)
        table = film_table(camera, run, rest, late, random)
    info = ForceInfo(
        "load cell", "simulated", (0.0, 1.0), (0.0, 50.0), group_delay_s=GROUP_DELAY_S, u_noise_n=0.01,
        u_gain_relative=0.002, preload_n=PRELOAD_N, u_preload_n=0.005, mains_frequency_hz=60.0,
    )  # fmt: skip
    data = TrialData(
        number=number, status="complete", reason="", started_utc=STARTED, simulated=True, sample_rate_hz=rate,
        time_s=time, raw_force_n=reading, force_raw=reading / 50.0, motor_command_v=np.zeros(time.size),
        encoder_count=np.column_stack([c - c[0] for c in counts]), encoders=encoders, force_info=info, camera=camera,
        blow_start_s=BLOW_S,
    )  # fmt: skip
    return data, table


def film_table(
    camera: CameraInfo, run: model.Solution, rest: model.RestState, late_s: float, random: np.random.Generator
) -> pd.DataFrame:
    """What the tracker gives: absolute whippen, jack and repetition lever relative to it, 0.4 mrad of noise."""
    stamped = camera.frame_time_s
    true = stamped - late_s
    columns = {"time_s": stamped, "frame": np.arange(stamped.size)}
    for body, i in (("whippen", 1), ("jack", 2), ("repetition", 3)):
        angle = np.interp(true, run.time_s, run.angle_rad[:, i]) - rest.angle_rad[i]
        angle += random.normal(0, 4e-4, stamped.size)
        name = body if body == "whippen" else f"{body}_relative"
        columns[f"{name}_rad"], columns[f"{name}_u_rad"] = angle, np.full(stamped.size, 4e-4)
    return pd.DataFrame(columns)


def make_session(folder: str | Path, *, planted: bool = True) -> Session:
    """Write the session, with its faults or without any."""
    action = model.load_action("hirschkorn2004")
    path, factor = FRICTION
    specimen = action.with_values({path: factor * action[path]}) if planted else action
    info = SessionInfo(
        simulated=True, name="planted faults" if planted else "clean", operator="sessions/make_planted.py",
        rig=FileInfo(name="none"), profile=FileInfo(name="forte, short"), created_utc=STARTED,
    )  # fmt: skip
    session = Session.create(Path(folder), info)
    for number in range(1, 10):
        data, table = record_trial(number, specimen, PLANTED.get(number) if planted else None)
        session.add_trial(data)
        if table is not None:
            session.write_derived("angles", number, table)
    return session


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "planted_faults"
    print(make_session(target).path)
