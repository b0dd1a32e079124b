"""Strokes of the virtual bench with known truth, recorded by its sensors, and errors of their records.

Seeds, profiles and specimens differ from all those used for tuning.  Each stroke is one plant run on a time base ten
times finer than the samples; the truth is read from that run, the trial from the simulated scales and load cell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import model
import rig.simulated
from rig.configuration.rig_file import load_rig
from rig.session import CameraInfo, EncoderInfo, ForceInfo, TrialData
from rig.simulated.bench.plant import ActionPlant, PlantTruth, load_plant
from rig.simulated.bench.sensors import EncoderSignals, ForceSignal, load_sensors

BENCH = Path(rig.simulated.__file__).with_name("bench.toml")
FINE = 10
GROUP_DELAY_S = 0.0024
BEFORE_S = 0.25
AFTER_S = 0.6

# corners (s after the onset, N of the motor), straight lines between them; none is a shipped profile
KINDS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "forte": ((0, 0.02, 0.05, 0.06, 0.27, 0.36), (0, 1.2, 7.0, 11.0, 11.0, 0)),
    "piano": ((0, 0.15, 0.16, 0.175, 0.215, 0.28, 0.5, 0.57), (0, 1.25, 1.25, 0.72, 0.72, 1.5, 1.5, 0)),
    "double": ((0, 0.055, 0.06, 0.11, 0.13, 0.19, 0.25, 0.26, 0.42, 0.5), (0, 9, 10, 10, 0, 0, 8, 11, 9, 0)),
    "staccato": ((0, 0.02, 0.035, 0.05), (0, 9, 9, 0)),
    "slow": ((0, 0.6, 0.9, 1.1), (0, 2.2, 2.2, 0)),
    "mf": ((0, 0.03, 0.06, 0.08, 0.25, 0.35), (0, 5, 7.5, 7.5, 7.5, 0)),
    "rebound": ((0, 0.03, 0.05, 0.08, 0.12, 0.14, 0.2, 0.3), (0, 8, 9, 3, 3, 10, 10, 0)),
    "ff2": ((0, 0.01, 0.02, 0.05, 0.2, 0.3), (0, 15, 18, 12, 12, 0)),
    "fortissimo": ((0, 0.02, 0.035, 0.04, 0.2, 0.28), (0, 8, 18, 20, 14, 0)),
}
# specimens out of regulation, played forte
MISREGULATED: dict[str, dict[str, float]] = {
    "no let-off": {"contact08.second.y": 4e-3},
    "missed check": {"contact04.second.x": -8e-3},
}


@dataclass(frozen=True)
class Stroke:
    """A recorded trial, its true motion (fine time base), and the specimen."""

    data: TrialData
    truth: PlantTruth


@cache
def _plant(rate_hz: float, seed: int, effects: tuple[str, ...], scene: model.SceneChoice | None = None) -> ActionPlant:
    return load_plant(BENCH, seed, rate_hz, effects, scene)


def command_n(kind: str, time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Motor force over time of one stroke, with randomly drawn strength and pace."""
    at, newton = KINDS["forte" if kind in MISREGULATED else kind]
    pace, strength = rng.uniform(0.9, 1.1), rng.uniform(0.85, 1.15)
    if kind == "piano":
        pace, strength = rng.uniform(0.97, 1.03), rng.uniform(0.98, 1.1)
    corners = BEFORE_S + rng.uniform(0, 1e-3) + pace * np.array(at)
    return strength * np.interp(time_s, corners, newton)


@dataclass(frozen=True)
class StrokeOptions:
    """How a stroke is played and read; `changed` adds to parameters of the specimen (SI), `scene` to what it is.

    Trials that are ``alike`` differ only by the bench's scatter and the given strength and delay.
    """

    rate_hz: float = 5000.0
    jitter_counts: float = 0.0
    changed: Mapping[str, float] | None = None
    effects: tuple[str, ...] = ()
    scene: model.SceneChoice | None = None
    alike: bool = False
    strength: float = 1.0
    late_s: float = 0.0


def play(kind: str, seed: int, number: int = 1, **options: Any) -> Stroke:
    """Return one stroke of one kind on the bench with one seed; options are those of `StrokeOptions`."""
    given = StrokeOptions(**options)
    rate_hz, strength, changed = given.rate_hz, given.strength, given.changed
    rng = np.random.default_rng([seed, 0 if given.alike else number, 99])
    plant = _plant(FINE * rate_hz, seed, given.effects, given.scene)
    shipped = plant.action
    moved = {**MISREGULATED.get(kind, {}), **(changed or {})}
    try:
        plant.action = shipped.with_values({path: shipped[path] + by for path, by in moved.items()})
        plant.start_trial(number)
        length = BEFORE_S + 1.2 * KINDS["forte" if kind in MISREGULATED else kind][0][-1] + AFTER_S
        edges = np.arange(int(length * rate_hz)) / rate_hz
        newton = strength * command_n(kind, edges - given.late_s, rng)
        lift_m = plant.advance(np.repeat(newton / 12.0, FINE)).key_lift_m
        truth = plant.truth()
    finally:
        plant.action = shipped
    return Stroke(record(truth, seed, number, rate_hz, given.jitter_counts, lift_m), truth)


def record(
    truth: PlantTruth, seed: int, number: int, rate_hz: float, jitter_counts: float, lift_m: np.ndarray | None = None
) -> TrialData:
    """Return a stroke as measured by scales and load cell; ``lift_m`` is how far the key's pivot has risen."""
    sensors, config = load_sensors(BENCH, seed=seed), load_rig("virtual").config
    rng = np.random.default_rng([seed, number, 98])
    time = truth.time_s[::FINE]
    if lift_m is None and "key_lift" in truth.coordinates:
        lift_m = truth.column("key_lift")
    lift = None if lift_m is None else lift_m[::FINE]
    count = EncoderSignals(sensors.encoders, seed, number).quarter_counts(truth.angle_rad[::FINE][:, [0, 1, 4]], lift)
    count = count + np.round(rng.normal(0, jitter_counts, count.shape)).astype(np.int64) * (jitter_counts > 0)
    delayed = np.interp(time - GROUP_DELAY_S, truth.time_s, truth.force_n, left=truth.force_n[0])
    raw = ForceSignal(sensors.force, seed, number).millivolts_per_volt(delayed, time)
    f = config.force
    encoders = tuple(
        replace(EncoderInfo.from_config(e), u_scale_relative=e.certificate.u_relative if e.certificate else 0.0)
        for e in config.encoders
    )
    per_unit = (f.physical_n[1] - f.physical_n[0]) / (f.electrical[1] - f.electrical[0])
    return TrialData(
        number=number, status="complete", started_utc="2026-11-21T09:00:00Z", simulated=True, sample_rate_hz=rate_hz,
        time_s=time, raw_force_n=raw * per_unit, force_raw=raw, motor_command_v=np.zeros(time.size),
        encoder_count=count - count[0],
        encoders=encoders, force_info=ForceInfo.from_config(config, GROUP_DELAY_S),
        blow_start_s=BEFORE_S,
    )  # fmt: skip


CHANNELS = ("key", "whippen", "hammer")
FILMED = 2
"""The trial that has a film, where one has."""
Change = Callable[[TrialData, Stroke], TrialData]


def recount(data: TrialData, columns: Callable[[np.ndarray], np.ndarray]) -> TrialData:
    """Return the trial with changed encoder counts."""
    count = columns(data.encoder_count.copy())
    return replace(data, encoder_count=count - count[0])


def swapped(i: int, j: int) -> Change:
    """Angles of two bodies swapped."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        per = np.array([e.rad_per_count for e in data.encoders])
        order = [0, 1, 2]
        order[i], order[j] = j, i
        return recount(data, lambda c: np.round((c * per)[:, order] / per).astype(np.int64))

    return change


def scaled(i: int, by: float) -> Change:
    return lambda data, _: recount(data, lambda c: np.round(c * np.where(np.arange(3) == i, by, 1.0)).astype(np.int64))


def read_late(i: int, by_s: float) -> Change:
    """An encoder that reads later."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        late = np.round(np.interp(data.time_s - by_s, data.time_s, data.encoder_count[:, i]))
        return recount(data, lambda c: np.where(np.arange(3) == i, late[:, None], c).astype(np.int64))

    return change


def wrong_at_rest(i: int, by_rad: float) -> Change:
    """An encoder whose reading at rest is wrong: it reads more once its body has turned by a milliradian."""

    def change(data: TrialData, stroke: Stroke) -> TrialData:
        per = data.encoders[i].rad_per_count
        more = -np.expm1(-np.abs(data.encoder_count[:, i] * per) / 1e-3) * by_rad / per
        return recount(data, lambda c: np.round(c + np.where(np.arange(3) == i, more[:, None], 0.0)).astype(np.int64))

    return change


def force(made: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Change:
    """Another force, of that and the time."""
    return lambda data, _: replace(data, raw_force_n=made(data.raw_force_n, data.time_s))


def louder(by: float) -> Change:
    return force(lambda f, t: f * by)


def delayed(by_s: float) -> Change:
    return force(lambda f, t: np.interp(t - by_s, t, f))


def stretched(by: float) -> Change:
    """A clock that reads ``by`` times the true time, and so the delay of a converter's filter, which counts samples."""
    return lambda data, _: replace(
        data,
        time_s=data.time_s * by,
        force_info=replace(data.force_info, group_delay_s=data.force_info.group_delay_s * by),
    )


def specimen_change(which: str, friction: tuple[str, float] | None) -> dict[str, float]:
    """Changes to the bench's specimen that give the requested one."""
    bench = load_plant(BENCH, 1, 5000.0).action
    printed = model.load_action()
    moved = {}
    if which == "printed":
        moved = {
            p: printed[p] - bench[p] for p in printed.quantities if p in bench.quantities and printed[p] != bench[p]
        }
    if friction is not None:
        path, factor = friction
        base = printed[path] if which == "printed" else bench[path]
        moved[path] = factor * base - bench[path]
    return moved


@lru_cache(maxsize=64)
def stroke_of(kind: str, seed: int, number: int, specimen: str, options: tuple[tuple[str, object], ...]) -> Stroke:
    """One stroke; strokes without faults are played once."""
    given = dict(options)
    changed = specimen_change(specimen, given.pop("friction", None))  # type: ignore[arg-type]
    for path, by in dict(given.pop("changed", ())).items():  # type: ignore[call-overload]
        changed[path] = changed.get(path, 0.0) + by
    return play(kind, seed, number=number, changed=changed, alike=True, **given)


def film(stroke: Stroke, late_s: float, rng: np.random.Generator) -> tuple[CameraInfo, pd.DataFrame]:
    """Tracker output for one stroke."""
    camera = CameraInfo(2000.0, 0.0301, 1e-4, int((stroke.truth.time_s[-1] - 0.05) * 2000), 2e-6)
    stamped = camera.frame_time_s
    angle = stroke.truth.angles_at(np.maximum(stamped - late_s, 0.0)) - stroke.truth.angle_rad[0]
    columns = {"time_s": stamped, "frame": np.arange(stamped.size)}
    for name, i in (("whippen", 1), ("jack_relative", 2), ("repetition_relative", 3)):
        columns[f"{name}_rad"] = angle[:, i] + rng.normal(0, 4e-4, stamped.size)
        columns[f"{name}_u_rad"] = np.full(stamped.size, 4e-4)
    return camera, pd.DataFrame(columns)
