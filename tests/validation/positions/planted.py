"""Recordings of positions with a known truth: an action is played by force and seen by two sensors like the Kawai's.

Its key and hammer go through the readings of both rulers, 17 bit and 2 kHz into a table, and from there the way of any
recording. What a sensor shows of a turn is written here a second time, independent of the package.
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

RISE = ((0.0, 0.0), (0.01, 0.05), (0.02, 0.15), (0.03, 0.3), (0.04, 0.5), (0.05, 0.73), (0.06, 1.0))
"""A forte's rise: s, share of its level."""
LEVEL_N = 10.0
HELD_N = 3.0
"""Force on a key that is held: more presses it beyond its ruler."""


def strike(hold_s: float, fall_s: float) -> list[tuple[float, float]]:
    """Corner points (s, N) of one strike: a rise, a hold, a fall."""
    rise, end_s = [(t, LEVEL_N * f) for t, f in RISE], 0.06 + hold_s
    return [*rise, (0.08, HELD_N), (max(end_s, 0.081), HELD_N), (end_s + 0.02 + fall_s, 0.0)]


KINDS = {"fast": strike(0.3, 0.05), "slide-off": strike(0.02, 0.004)}


@dataclass(frozen=True)
class Specimen:
    """An action that is played, and how its sensors are tied."""

    action: model.Action = REGULATED
    key_gain: float = 0.0  # logarithm of what the key turns by more per metre than in a dip of 10 mm for its ruler
    hammer_gain: float = 0.0  # logarithm of what the sensor shows by more per turn than the way to the string
    hammer_curve: Mapping[float, float] = field(default_factory=dict)  # share of the ruler -> shown too high, rulers

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
    (ruler,) = (RulerInfo(**one.ruler.model_dump()) for one in _mapping().positions if one.ruler.body == body)
    return float(np.ptp(ruler.displacement_m))


def _mapping() -> ImportMapping:
    return rig.load_mapping(SHIPPED / "mapping.toml").config


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


def record(folder: Path, specimen: Specimen, kinds: Sequence[str]) -> Session:
    """Write strokes one after the other as the sensors see them, without noise, and import them."""
    played = [play(specimen.action, kind) for kind in kinds]
    starts = 36.0 + np.concatenate([[0.0], np.cumsum([t[-1] + 1.0 / (RATE_HZ * OVER) for t, _, _ in played])])
    time_s = np.concatenate([start + t for start, (t, _, _) in zip(starts, played, strict=False)])[::OVER]
    columns = [time_s]
    for one in _mapping().positions:
        key = one.ruler.body == "key"
        turn = np.concatenate([stroke[1 if key else 2] for stroke in played])[::OVER]
        place = specimen.key_m(turn) if key else specimen.hammer_m(turn)
        raw = np.clip(one.offset + one.gain * _reading(place, RulerInfo(**one.ruler.model_dump())), 0.0, MOST)
        columns.append(np.round(raw * 2**BITS) / 2**BITS)
    names = ["time_s", *(one.channel for one in _mapping().positions)]
    table = folder / "planted.csv"
    np.savetxt(table, np.column_stack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.7f")
    return rig.import_session(folder / "planted", [table], rig.load_mapping(SHIPPED / "mapping.toml"))


def _reading(place_m: Array, ruler: RulerInfo) -> Array:
    """Reading at which the sensor's curve shows a place; beyond the ruler it goes on at a fifth of its slope."""
    curve = ruler_curve(ruler)
    grid = np.linspace(curve.places[0], curve.places[-1], 3001)
    place = curve.value(grid)
    place = place - place[0] + 1e-12 * np.arange(grid.size)
    ends = [(grid[-1] - grid[-40]) / (place[-1] - place[-40]), (grid[40] - grid[0]) / (place[40] - place[0])]
    beyond = ends[0] * np.maximum(place_m - place[-1], 0.0) + ends[1] * np.minimum(place_m - place[0], 0.0)
    return np.asarray(np.interp(place_m, place, grid) + BEYOND * beyond)
