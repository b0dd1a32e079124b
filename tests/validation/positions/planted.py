"""Recordings of positions with a known truth: an action is played by force and seen by two sensors like the Kawai's.

The specimen is the set identified on `sessions/kawai_kg3c`, some of its parameters moved. Its key and hammer go through
the readings of both rulers (drawn anew within their uncertainty), drift, hum, noise, 17 bit and 2 kHz into a table, and
from there the way of any recording: import, smoothing, prediction by the key (docs/explanation/positions.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import model
import rig
from model.scene.selection import SceneChoice
from rig.foreign.mapping import ImportMapping
from rig.session.info import RulerInfo
from rig.session.ruler import ruler_curve
from validation.conventions import HAMMER
from validation.infer.positions import read_identified
from validation.pipeline.compare_positions import PositionComparison, compare_positions
from validation.prediction.positions import (
    NAMES,
    Nominal,
    Sensing,
    action_of,
    bowed,
    hammer_place,
    hammer_reading,
    sensing_of,
)

Array = NDArray[np.float64]

SHIPPED = Path(__file__).resolve().parents[3] / "sessions" / "kawai_kg3c"
RATE_HZ, OVER = 2000.0, 5
BITS = 17
MOST = 0.999
"""Share of the converter's range where a sensor's own ends: the import refuses one that is at the converter's."""
BEYOND = 0.2
"""Slope of a sensor beyond its ruler, of that at the end."""
REST_S, GAP_S = 1.0, 0.6
HUM = {"key": 0.0008, "hammer": 0.001}
"""Amplitude of the hum on a reading."""
DRIFT = {"key": 0.0008, "hammer": 0.004}
"""Standard deviation of a reading's drift at rest, from stroke to stroke."""

RISE = ((0.0, 0.0), (0.01, 0.05), (0.02, 0.15), (0.03, 0.3), (0.04, 0.5), (0.05, 0.73), (0.06, 1.0))
"""A forte's rise: s, share of its level."""
HELD_N = 3.0
"""Force on a key that is held: more presses it beyond its ruler."""


def strike(
    at_s: float, level_n: float, hold_s: float, fall_s: float, least_n: float = 0.0
) -> list[tuple[float, float]]:
    """Corner points (s, N) of one strike: a rise, a hold, a fall to ``least_n``."""
    rise = [(at_s + t, max(level_n * f, least_n)) for t, f in RISE]
    held_n, end_s = min(level_n, HELD_N), at_s + 0.06 + hold_s
    return [*rise, (at_s + 0.08, held_n), (max(end_s, at_s + 0.081), held_n), (end_s + 0.02 + fall_s, least_n)]


KINDS: dict[str, list[tuple[float, float]]] = {
    "slow": [(0.0, 0.0), (1.5, 2.2), (2.0, 2.2), (3.0, 0.0)],
    "medium": strike(0.0, 4.0, 0.5, 0.15),
    "fast": strike(0.0, 10.0, 0.3, 0.05),
    "fortissimo": strike(0.0, 16.0, 0.2, 0.05),
    "slide-off": strike(0.0, 10.0, 0.02, 0.004),
    "repetitions": [point for k in range(8) for point in strike(0.2 * k, 8.0, 0.02, 0.02, 0.0 if k in (3, 7) else 0.2)],
}
"""Force on the key's front over time: corner points, s and N."""


@dataclass(frozen=True)
class Specimen:
    """An action that is played, how its sensors are tied, effects the model under test has not, and a seed."""

    action: model.Action
    sensing: Sensing
    effects: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Truth:
    """What happened, at `OVER` times the sensors' rate: times (n,) s of the recording, turns (n,) rad from rest."""

    kind: str
    time_s: Array
    key_turn: Array
    hammer_turn: Array
    hammer_m: Array

    def speed(self, low: float = 0.6, high: float = 0.9) -> float:
        """Mean speed of the calibrated point between two shares of its highest place in the first strike, m/s."""
        top = float(self.hammer_m.max())
        end = int(np.argmax(self.hammer_m >= high * top))
        begin = int(np.flatnonzero(self.hammer_m[:end] < low * top)[-1])
        return float((self.hammer_m[end] - self.hammer_m[begin]) / (self.time_s[end] - self.time_s[begin]))


def identified_specimen(
    moved: dict[str, float] | None = None, effects: tuple[str, ...] = (), seed: int = 0
) -> Specimen:
    """The shipped identified set, parameters moved by so many standard deviations of their priors."""
    record = read_identified(SHIPPED)
    action, z = model.load_action(record.action), np.array(record.z)
    for name, by in (moved or {}).items():
        z[NAMES.index(name)] += by
    rulers = _rulers()
    sensing = sensing_of(
        Nominal.of(action), z, *(float(np.ptp(rulers[body].displacement_m)) for body in ("key", "hammer"))
    )
    return Specimen(_stopped(action_of(action, z), sensing), sensing, effects, seed)


def _stopped(action: model.Action, sensing: Sensing) -> model.Action:
    """The action with its key's front felt where a key that is held ends its ruler: no parameter of the set says so."""
    up, end = "contact02.second.y", sensing.key_rad_per_m * (_travel("key") - sensing.key_zero_m)

    def beyond(by_m: float) -> float:
        at = action.with_values({up: action[up] + by_m})
        return float(model.rest_state(at).angle_rad[0] - model.rest_state(at, HELD_N).angle_rad[0]) - end

    return action.with_values({up: action[up] + float(brentq(beyond, -3e-3, 3e-3, xtol=1e-6))})


def _mapping() -> ImportMapping:
    return rig.load_mapping(SHIPPED / "mapping.toml").config


def _rulers() -> dict[str, RulerInfo]:
    return {one.ruler.body: RulerInfo(**one.ruler.model_dump()) for one in _mapping().positions}


def play(specimen: Specimen, kind: str, first_s: float) -> Truth:
    """Play one kind of stroke by force, rest before and after."""
    points = np.array(KINDS[kind])
    end = REST_S + float(points[-1, 0]) + GAP_S
    time_s = np.arange(round(end * RATE_HZ * OVER)) / (RATE_HZ * OVER)
    force_s = np.arange(0.0, end + 1e-3, 5e-4)
    force = np.interp(force_s - REST_S, points[:, 0], points[:, 1], left=0.0, right=0.0)
    scene = SceneChoice(effects=specimen.effects)
    run = model.simulate(specimen.action, force_s, force, output_time_s=time_s, tolerance=1e-5, scene=scene)
    key, hammer = (run.angle_rad[0, k] - run.angle_rad[:, k] for k in (0, HAMMER))
    return Truth(kind, first_s + time_s, key, hammer, hammer_reading(hammer, specimen.sensing, _travel("hammer")))


def _travel(body: str) -> float:
    return float(np.ptp(_rulers()[body].displacement_m))


def write_recording(path: Path, specimen: Specimen, kinds: Sequence[str], exact: bool = False) -> list[Truth]:
    """Write strokes one after the other as the sensors see them; ``exact``: without noise, drift, hum, ruler errors."""
    random = np.random.default_rng([specimen.seed, 7])
    truths, at = [], 36.0
    for kind in kinds:
        truths.append(play(specimen, kind, at))
        at = float(truths[-1].time_s[-1]) + 1.0 / (RATE_HZ * OVER)
    time_s = np.concatenate([one.time_s for one in truths])[::OVER]
    columns = [time_s]
    for one in _mapping().positions:
        turn = np.concatenate([t.key_turn if one.ruler.body == "key" else t.hammer_turn for t in truths])[::OVER]
        if one.ruler.body == "key":
            place = _key_place(turn, specimen.sensing)
        else:
            place = hammer_place(turn, specimen.sensing, _travel("hammer"))
        reading = _reading(place, RulerInfo(**one.ruler.model_dump()), None if exact else random)
        if not exact:
            away = np.concatenate([np.full(t.time_s.size, DRIFT[one.name] * random.standard_normal()) for t in truths])
            reading = reading + away[::OVER] + one.u_noise * random.standard_normal(reading.size)
            reading = reading + HUM[one.name] * np.sin(2.0 * np.pi * (60.0 * time_s + random.random()))
        raw = np.clip(one.offset + one.gain * reading, 0.0, MOST)
        columns.append(np.round(raw * 2**BITS) / 2**BITS)
    names = ["time_s", *(one.channel for one in _mapping().positions)]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.7f")
    return truths


def _key_place(turn: Array, sensing: Sensing) -> Array:
    """Displacement of the key's calibrated point (n,), m, at which the model's key has turned so far."""
    u = np.linspace(-0.3, 1.6, 4001)
    grid = sensing.key_rad_per_m * (_travel("key") * bowed(u, sensing.key_shape) - sensing.key_zero_m)
    up = np.maximum.accumulate(grid)
    return np.asarray(_travel("key") * np.interp(turn - sensing.key_rad_per_m * sensing.key_zero_m, up, u))


def _reading(place_m: Array, ruler: RulerInfo, random: np.random.Generator | None) -> Array:
    """Reading at which the sensor's true curve shows a place; beyond the ruler it goes on at a fifth of its slope.

    The true curve is as smooth as the ruler's, and off by what it was read wrong: the points of the mapping lie beside
    it as far as they are uncertain.
    """
    curve = ruler_curve(ruler)
    grid = np.linspace(curve.places[0], curve.places[-1], 3001)
    place = curve.value(grid) if random is None else np.maximum.accumulate(curve.drawn(random, grid))
    place = place - place[0] + 1e-12 * np.arange(grid.size)
    ends = [(grid[-1] - grid[-40]) / (place[-1] - place[-40]), (grid[40] - grid[0]) / (place[40] - place[0])]
    out = np.interp(place_m, place, grid)
    out += BEYOND * ends[0] * np.maximum(place_m - place[-1], 0.0) + BEYOND * ends[1] * np.minimum(
        place_m - place[0], 0.0
    )
    return np.asarray(out)


def compare(
    specimen: Specimen, kinds: Sequence[str], folder: Path, exact: bool = False
) -> tuple[list[Truth], PositionComparison]:
    """Write, import and compare a recording by the shipped identified set."""
    truths = write_recording(folder / "planted.csv", specimen, kinds, exact)
    session = rig.import_session(
        folder / "planted", [folder / "planted.csv"], rig.load_mapping(SHIPPED / "mapping.toml")
    )
    return truths, compare_positions(session, identified=SHIPPED)


KEPT_ASIDE = ("fast", "repetitions", "slide-off")
OFF = {"let_off": 0.1, "check": 0.05, "hammer_friction": 0.5, "knuckle_friction": 0.4, "spring": -0.1}
"""How the specimen differs from the set: as another day's regulation and weather would."""
