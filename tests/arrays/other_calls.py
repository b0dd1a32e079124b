"""The smallest call of what takes arrays in vision, rig, validation and pianorig, as in `tests.arrays.model_calls`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from unittest.mock import MagicMock

import numpy as np

import rig
import rig.simulated
import vision
from pianorig.workflows import DrivingForce
from rig.session.info import NO_FORCE
from rig.simulated.backend import DEFAULT_BENCH
from tests.arrays.forms import Gives, Out
from tests.arrays.model_calls import ROWS, Arguments, action, blow

WORKFLOWS, BACKEND = "pianorig.workflows", "rig.simulated.SimulatedBackend"
CAMERA = "rig.simulated.bench.camera"
ANY_SHAPE = (
    *("vision.ccw_to_picture", "vision.picture_to_ccw", "vision.ground_to_picture", "vision.write_picture"),
    *("vision.Projection.to_picture", "vision.Projection.to_plane", "vision.write_mraw"),
    *("rig.Profile.force_at", "rig.TrialData.convert_counts"),
)
HEAVY = {
    "vision.track": ("gives vision.tracking.track_film.frame_times",),
    "vision.preview": ("gives vision.tracking.retrack.frame_times",),
    "vision.retrack_frames": ("gives vision.tracking.retrack.frame_times",),
    f"{BACKEND}.configure": ("rig.daq.tasks.check_command",),
    f"{BACKEND}.read_loopback": (
        "rig.daq.tasks.motor_task", "rig.daq.tasks.prepare_command", "rig.daq.tasks.load_command",
    ),
    "rig.simulated.film_trial": (f"{CAMERA}.film_scene", f"gives {CAMERA}._Exposures"),
}  # fmt: skip


def picture() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 200, (12, 16)).astype(np.uint8)


@cache
def film() -> vision.ArrayFilm:
    return vision.ArrayFilm(np.stack([picture()] * 4), 1.0)


def bodies() -> list[vision.Body]:
    return [vision.Body("plate", np.array([[2.0, 2.0], [13.0, 2.0], [13.0, 9.0]]))]


def projection() -> vision.Projection:
    return vision.Projection(16, 12, radial=0.125)


def swing(time_s: np.ndarray) -> np.ndarray:
    return np.rint(256.0 * np.exp(-(((time_s - 128.0) / 16.0) ** 2)))


@cache
def config() -> rig.RigConfig:
    return rig.load_rig("virtual").config


def unopened() -> MagicMock:
    """A bench that is never reached: the test stops before."""
    return MagicMock()


def recording() -> np.ndarray:
    """Force of a push that ends at the key bed, N, at 1 kHz."""
    push = np.concatenate([np.zeros(100), np.arange(100.0) / 32.0, np.full(4, 20.0), np.full(96, 4.0)])
    return np.append(push, np.zeros(50))


def trial() -> rig.TrialData:
    return rig.TrialData(
        number=1, status="complete", started_utc="", simulated=True, sample_rate_hz=1.0, time_s=ROWS, raw_force_n=ROWS,
        force_raw=ROWS, motor_command_v=ROWS, encoder_count=np.arange(24)[:, None] * np.ones(3, np.int64),
        encoders=tuple(rig.EncoderInfo(name, 3600) for name in ("key", "whippen", "hammer")), force_info=NO_FORCE,
    )  # fmt: skip


CALLS: dict[str, Callable[[], Arguments]] = {
    f"{WORKFLOWS}.DrivingForce.force_at": lambda: {
        "self": DrivingForce(np.array([0.0, 1.0]), np.array([0.0, 4.0])), "time_s": ROWS / 32.0,
    },
    f"{WORKFLOWS}.blow_events": lambda: {"action": action(), "solution": blow(), "force": np.repeat([0.0, 1.0], 12)},
    f"{WORKFLOWS}.draw_deviations": lambda: {
        "at": np.array([0.0, 1.0, 2.0]), "away": np.array([1.0, -2.0, 4.0]), "u": np.array([1.0, 2.0, 0.5]),
        "words": ("left over", "swing", "friction, mN m"), "path": Out("left.png"),
    },
    "vision.ccw_to_picture": lambda: {"angle_rad": ROWS},
    "vision.picture_to_ccw": lambda: {"phi_rad": ROWS},
    "vision.ground_to_picture": lambda: {
        "points_m": np.ones((3, 2)), "scale_px_per_m": 2.0, "origin_px": np.array([1.0, 2.0]),
    },
    "vision.Projection.to_picture": lambda: {"self": projection(), "rectified_px": np.ones((3, 2))},
    "vision.Projection.to_plane": lambda: {"self": projection(), "seen_px": np.ones((3, 2))},
    "vision.ArrayFilm": lambda: {"frames": np.stack([picture()] * 3), "bit_depth": 8},
    "vision.write_mraw": lambda: {
        "path": Out("film.mraw"), "frames": [picture() * np.uint16(16)] * 2, "frame_rate_hz": 25.0, "bit_depth": 12,
    },
    "vision.write_picture": lambda: {"path": Out("grey.png"), "picture": picture()},
    "vision.cramer_rao_bound": lambda: {
        "picture": picture().astype(float), "mask": np.ones((12, 16), bool), "noise_grey": 2.0,
    },
    "vision.estimate_offset": lambda: {
        "time_s": np.arange(48.0, 208.0), "angle_rad": swing(np.arange(49.0, 209.0)), "u_angle_rad": np.ones(160),
        "encoder_time_s": np.arange(256.0), "encoder_rad": swing(np.arange(256.0)),
    },
    **{
        f"vision.{name}": lambda: {"path_or_source": film(), "bodies": bodies(), "frame_time_s": ROWS[:4]}
        for name in ("track", "preview")
    },
    "vision.retrack_frames": lambda: {
        "path_or_source": film(), "bodies": bodies(), "frames": [1], "places": [{}], "frame_time_s": ROWS[:4],
    },
    "rig.make_target": lambda: {
        "name": "push", "force_n": recording(), "interval_s": 1e-3, "sample_rate_hz": 1000.0, "key_bottom_s": 0.2,
    },
    "rig.ChannelTable.split_at_breaks": lambda: {
        "self": rig.ChannelTable("recording", {"force": ROWS}), "time_s": ROWS / 8.0, "interval_s": 0.125,
    },
    "rig.Profile.force_at": lambda: {"self": rig.load_profile("piano"), "time_s": ROWS},
    "rig.TrialData.convert_counts": lambda: {"self": trial(), "zero": np.array([[1, 2, 3]])},
    f"{BACKEND}.configure": lambda: {"self": unopened(), "config": config(), "command_v": np.array([0.0, 1.0, 0.0])},
    f"{BACKEND}.read_loopback": lambda: {
        "self": unopened(), "config": config(), "channel": "ai0", "command_v": np.array([0.0, 1.0, 0.0]),
    },
    "rig.simulated.ActionPlant.advance": lambda: {
        "self": rig.simulated.load_plant(DEFAULT_BENCH, 1, 5000.0), "command_v": np.array([0.0, 1.0]),
    },
    **{
        f"rig.simulated.PlantTruth.{name}": lambda: {
            "self": rig.simulated.PlantTruth(ROWS, np.ones((24, 6)), np.zeros((24, 6)), ROWS, action(), 1.0),
            "time_s": np.array([0.0, 3.0]),
        }
        for name in ("angles_at", "film_angles_at")
    },
    "rig.simulated.film_trial": lambda: {
        "path": Out("film.mraw"), "frame_time_s": ROWS, "angle_rad_of_time": Gives(lambda t: np.zeros((len(t), 3))),
    },
    "rig.find_quiet": lambda: {
        "time_s": np.arange(512.0) / 2048.0, "force_n": np.maximum(np.arange(512.0) - 400.0, 0.0),
        "encoder_count": np.zeros((512, 3), np.int64),
    },
    "rig.correct_force": lambda: {
        "time_s": np.arange(512.0) / 2048.0, "force_n": np.maximum(np.arange(512.0) - 400.0, 0.0),
        "quiet": rig.find_quiet(np.arange(512.0) / 2048.0, np.maximum(np.arange(512.0) - 400.0, 0.0)),
    },
}  # fmt: skip
