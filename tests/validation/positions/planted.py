"""Recordings of positions with a known truth: an action is played by force and seen by two sensors like the Kawai's.

Its key and hammer go through the readings of both rulers (read wrong within their uncertainty), drift, hum, noise, 17
bit and 2 kHz into a table, and from there the way of any recording. What a sensor shows of a turn is written here a
second time, independent of the package.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

import model
import rig
from rig.foreign.mapping import ImportMapping
from rig.session import Session
from rig.session.info import RulerInfo
from rig.session.ruler import ruler_curve

Array = NDArray[np.float64]

SHIPPED = Path(__file__).resolve().parents[3] / "sessions" / "kawai_kg3c"
REGULATED = model.load_action("hirschkorn2004-regulated")
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
    "medium": strike(0.0, 4.0, 0.5, 0.15),
    "fast": strike(0.0, 10.0, 0.3, 0.05),
    "slide-off": strike(0.0, 10.0, 0.02, 0.004),
    "repetitions": [point for k in range(8) for point in strike(0.2 * k, 8.0, 0.02, 0.02, 0.0 if k in (3, 7) else 0.2)],
}
"""Force on the key's front over time: corner points, s and N."""


@dataclass(frozen=True)
class Specimen:
    """An action that is played, how its sensors are tied, and a seed."""

    action: model.Action = REGULATED
    key_gain: float = 0.0  # logarithm of what the key turns by more per metre than in a dip of 10 mm for its ruler
    hammer_gain: float = 0.0  # logarithm of what the sensor shows by more per turn than the way to the string
    hammer_curve: Mapping[float, float] = field(default_factory=dict)  # share of the ruler -> shown too high, rulers
    seed: int = 0

    def key_m(self, turn_rad: Array) -> Array:
        """Displacement of the key's calibrated point, m."""
        dip_rad = 0.010 / self.action["drive.point.x"]
        return np.asarray(turn_rad / dip_rad * np.exp(-self.key_gain) * travel("key"))

    def hammer_m(self, turn_rad: Array) -> Array:
        """What the hammer's sensor shows, m, if its ruler had no ends."""
        share = turn_rad / STRING_RAD * np.exp(self.hammer_gain)
        at, more = zip((0.0, 0.0), *self.hammer_curve.items(), (1.0, 0.0), strict=True)
        return np.asarray(travel("hammer") * (share + PchipInterpolator(at, more)(np.clip(share, 0.0, 1.0))))


def _string_rad() -> float:
    rest = float(model.rest_state(REGULATED).angle_rad[4])
    turn = np.linspace(0.0, 0.6, 60001)
    height = model.observables.hammer_height_from_angle(REGULATED, rest - turn)
    return float(turn[int(np.argmax(height <= 0.0))])


STRING_RAD = _string_rad()


def travel(body: str) -> float:
    """Length of a ruler, m."""
    return float(np.ptp(_rulers()[body].displacement_m))


def _mapping() -> ImportMapping:
    return rig.load_mapping(SHIPPED / "mapping.toml").config


def _rulers() -> dict[str, RulerInfo]:
    return {one.ruler.body: RulerInfo(**one.ruler.model_dump()) for one in _mapping().positions}


def play(action: model.Action, kind: str) -> tuple[Array, Array, Array]:
    """Play one kind of stroke by force, rest before and after: times (n,) s, turns of key and hammer (n,) rad."""
    points = np.array(KINDS[kind])
    end = REST_S + float(points[-1, 0]) + GAP_S
    time_s = np.arange(round(end * RATE_HZ * OVER)) / (RATE_HZ * OVER)
    force_s = np.arange(0.0, end + 1e-3, 5e-4)
    force = np.interp(force_s - REST_S, points[:, 0], points[:, 1], left=0.0, right=0.0)
    run = model.simulate(action, force_s, force, output_time_s=time_s, tolerance=1e-5)
    key, hammer = (run.angle_rad[0, k] - run.angle_rad[:, k] for k in (0, 4))
    return time_s, key, hammer


def record(folder: Path, specimen: Specimen, kinds: Sequence[str], exact: bool = False) -> Session:
    """Write strokes one after the other as the sensors see them, and import them.

    ``exact``: without noise, drift, hum, ruler errors.
    """
    random = np.random.default_rng([specimen.seed, 7])
    played = [play(specimen.action, kind) for kind in kinds]
    starts = 36.0 + np.concatenate([[0.0], np.cumsum([t[-1] + 1.0 / (RATE_HZ * OVER) for t, _, _ in played])])
    time_s = np.concatenate([start + t for start, (t, _, _) in zip(starts, played, strict=False)])[::OVER]
    columns = [time_s]
    for one in _mapping().positions:
        key = one.ruler.body == "key"
        turn = np.concatenate([stroke[1 if key else 2] for stroke in played])[::OVER]
        place = specimen.key_m(turn) if key else specimen.hammer_m(turn)
        reading = _reading(place, RulerInfo(**one.ruler.model_dump()), None if exact else random)
        if not exact:
            away = np.concatenate([np.full(t.size, DRIFT[one.name] * random.standard_normal()) for t, _, _ in played])
            reading = reading + away[::OVER] + one.u_noise * random.standard_normal(reading.size)
            reading = reading + HUM[one.name] * np.sin(2.0 * np.pi * (60.0 * time_s + random.random()))
        raw = np.clip(one.offset + one.gain * reading, 0.0, MOST)
        columns.append(np.round(raw * 2**BITS) / 2**BITS)
    names = ["time_s", *(one.channel for one in _mapping().positions)]
    table = folder / "planted.csv"
    np.savetxt(table, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.7f")
    return rig.import_session(folder / "planted", [table], rig.load_mapping(SHIPPED / "mapping.toml"))


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
