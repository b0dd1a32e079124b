"""The mechanics of the virtual bench: specimen action and motor arm, integrated with the model's kernels.

The device steps it from edge to edge of the sample clock; camera and tests read the whole truth of a trial afterwards.
The command is a zero-order hold in volts; the force spike at key bottom arises from the arm's inertia. bench.toml
declares how the specimen differs from the model under test, and what scatters from trial to trial; the same seed and
trial number give the same trial.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

import model
from model.parameters.effects import EFFECTS, KEY_LIFT, MOTOR, MOTOR_DRIVE, WINDING
from model.simulation.compliant_joints import pin_motion
from rig.arrays import ArrayRecord, as_numbers
from rig.errors import RigInputError
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, PlantBlock, bench_table, read_bench

TOLERANCE = 1e-6  # rad, of the specimen: a twentieth of an encoder's count
MOST_SCATTER = 0.3  # of a parameter from trial to trial, relative: a normal draw stays positive
KEPT_S = 60.0  # of a trial at most, for its whole truth to be kept: choice, of memory


@dataclass(frozen=True)
class PlantTruth(ArrayRecord):
    """What really happened in one trial, at the edges of the sample clock.

    Attributes
    ----------
    time_s : (n,)
    angle_rad, speed_rad_per_s : (n, k) key, whippen, jack, repetition, hammer, motor, then what effects of the specimen
        add: ``key_lift`` (m, m/s), ``shank``; named in ``coordinates``
    force_n : (n,) force of the arm on the key
    action : the specimen of this trial
    torque_per_volt_nm : of this trial
    coordinates : (k,) names of the columns
    """

    time_s: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    speed_rad_per_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    action: model.Action
    torque_per_volt_nm: float
    coordinates: tuple[str, ...] = ()

    def column(self, coordinate: str) -> NDArray[np.float64]:
        """Angle (n,) of one coordinate, rad (a length: m)."""
        return self.angle_rad[:, self.coordinates.index(coordinate)]

    def angles_at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Coordinates (k, c), rad, a length in m, with the columns `coordinates`, at times (k,), s, by cubic Hermite
        interpolation of angles and speeds; times outside the trial get the values at its ends."""
        t = np.clip(as_numbers(time_s, "times of the trial", 1), self.time_s[0], self.time_s[-1])
        i = np.clip(np.searchsorted(self.time_s, t, side="right") - 1, 0, len(self.time_s) - 2)
        h = (self.time_s[i + 1] - self.time_s[i])[:, None]
        x = (t - self.time_s[i])[:, None] / h
        q0, q1 = self.angle_rad[i], self.angle_rad[i + 1]
        v0, v1 = self.speed_rad_per_s[i], self.speed_rad_per_s[i + 1]
        return (
            (1 + 2 * x) * (1 - x) ** 2 * q0
            + x * (1 - x) ** 2 * h * v0
            + x * x * (3 - 2 * x) * q1
            + x * x * (x - 1) * h * v1
        )

    def film_angles_at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Angles (k, 3) of whippen, jack and repetition lever."""
        return self.angles_at(time_s)[:, 1:4]


class ActionPlant:
    """Specimen action played by the motor arm; implements `rig.simulated.bench.plant_protocol.Plant`."""

    def __init__(
        self,
        action: model.Action,
        choice: model.SceneChoice,
        torque_per_volt_nm: float,
        scatter: Mapping[str, float],
        seed: int,
        sample_rate_hz: float,
    ) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.action = action
        self.choice = choice
        self.torque_per_volt_nm = torque_per_volt_nm
        self.scatter = dict(scatter)
        self.seed = seed
        self.start_trial(1)

    def draw_specimen(self, trial: int) -> tuple[model.Action, float]:
        """Return the specimen of trial number ``trial`` and its torque per volt, N m/V, with the scatter that seed and
        number draw; the plant itself stays as it is."""
        random = np.random.default_rng([self.seed, trial])
        gain = self.torque_per_volt_nm
        changed = {}
        for path, relative in sorted(self.scatter.items()):
            factor = 1.0 + relative * float(np.clip(random.standard_normal(), -3.0, 3.0))
            if path == "motor_gain":
                gain *= factor
            else:
                changed[path] = self.action[path] * factor
        return self.action.with_values(changed), gain

    def start_trial(self, trial: int) -> None:
        """Put action and arm at rest for trial number ``trial``, draw its scatter from the seed and that number, and
        forget the truth of the trial before."""
        self._specimen, self._gain = self.draw_specimen(trial)
        scene = model.build_scene(self._specimen, self.choice)
        self._names = scene.bodies
        rest = model.rest_state(self._specimen, scene=scene).angle_rad
        self._run = model.Simulation(scene, model.State(0.0, rest, np.zeros(scene.size)), tolerance=TOLERANCE)
        self._edge = 0
        self._record: list[tuple[NDArray[np.float64], ...]] = []

    def _give(self) -> NDArray[np.float64] | None:
        """Rise of the key where its joint gives, at the last edges, m."""
        pins = self._run.scene.pins
        if ("key", "y") not in pins:
            return None
        return pin_motion(self._run.scene, self._run.remembered)[0][:, pins.index(("key", "y"))]

    def advance(self, command_v: ArrayLike) -> PlantBlock:
        """Hold each motor voltage of ``command_v`` (n,) for one sample period; return the state at the n edges at which
        they begin, before they have acted."""
        volts = as_numbers(command_v, "command", 1)
        count = len(volts)
        edges = np.arange(self._edge, self._edge + count + 1) / self.sample_rate_hz
        # a motor with its drive takes volts; its scatter is that of the amplifier's gain
        torque = volts * (self._gain / self.torque_per_volt_nm if WINDING in self._names else self._gain)
        changes = np.concatenate([[True], np.diff(torque) != 0.0])  # no stop where the value stays
        angles, speeds = self._run.advance(
            edges[-1],
            np.append(edges[:-1][changes], edges[-1]),
            np.append(torque[changes], torque[-1]),
            held=True,
            output_time_s=edges[:-1],
        )
        self._edge += count
        force = self._run.probe_forces(angles, speeds)[:, 0]
        if self._edge <= KEPT_S * self.sample_rate_hz:
            self._record.append((edges[:-1], angles, speeds, force))
        else:
            self._record.clear()
        encoded = [model.BODIES.index(body) for body in ENCODED_BODIES]
        lift = angles[:, self._names.index(KEY_LIFT)] if KEY_LIFT in self._names else self._give()
        return PlantBlock(
            time_s=edges[:-1],
            force_n=force,
            angle_rad=angles[:, encoded],
            motor_rad=angles[:, self._names.index(MOTOR)],
            key_lift_m=lift,
        )

    def truth(self) -> PlantTruth:
        """True motion and force at every edge since the trial started, with its specimen; RigInputError where the trial
        was longer than the 60 s that are kept, or has not moved on yet."""
        if not self._record:
            raise RigInputError(
                f"the virtual bench keeps {KEPT_S:g} s of a trial's truth, e.g. for its film; this was longer"
            )
        time, angles, speeds, force = (np.concatenate(parts) for parts in zip(*self._record, strict=True))
        return PlantTruth(time, angles, speeds, force, self._specimen, self._gain, self._names)


def _join_scenes(scene: model.SceneChoice, bench: model.SceneChoice) -> model.SceneChoice:
    """The specimen's scene, whose values go before, with what the bench adds."""
    if missing := set(model.BODIES) - set(scene.bodies):
        raise RigInputError(f"scene: found one without {', '.join(sorted(missing))}, allowed one with all bodies")
    effects = tuple(dict.fromkeys((*scene.effects, *bench.effects)))
    return replace(scene, effects=effects, values=(*bench.values, *scene.values))


def load_plant(
    bench_path: Path,
    seed: int | None,
    sample_rate_hz: float,
    effects: Collection[str] = (),
    scene: str | model.SceneChoice | None = None,
) -> ActionPlant:
    """Build the specimen action with its motor arm, at rest, as a bench file (TOML) describes it; ``seed`` None takes
    the file's. ``effects``: further ones by name; ``scene``: the specimen's, None for its action's own. Refuse bad
    values.

    Parameters
    ----------
    bench_path : Path
        TOML file.
    seed : int or None
        Wins over the file's.
    sample_rate_hz : float
    effects : collection of str
        Effects (`model.parameters.effects`) that the specimen has beside those with a table in the file.
    scene : str, SceneChoice or None
        Scene of the specimen by name, file or choice, to which these effects come; by default that of its action.

    Returns
    -------
    ActionPlant

    Raises
    ------
    RigInputError
        A value that is missing or out of range, with its name.

    Examples
    --------
    >>> from rig.simulated import load_plant
    >>> from rig.simulated.backend import DEFAULT_BENCH
    >>> plant = load_plant(DEFAULT_BENCH, seed=1, sample_rate_hz=5000.0)
    >>> plant.start_trial(1)
    """
    path = Path(bench_path)
    bench = read_bench(path)
    specimen, _, scatter = (bench_table(bench, name, path) for name in ("specimen", "motor_arm", "scatter"))
    tables = {effect: bench[effect] for effect in EFFECTS if effect in bench}
    given = model.load_action(specimen.get("action", "hirschkorn2004"), specimen.get("set", {}))
    choice = _join_scenes(model.choice_of(given, scene), model.scene_of({"effects": [*effects], **tables}, str(path)))
    known = {"seed", "specimen", "motor_arm", "motor", "scatter", "force_sensor", "encoders", "wiring", *EFFECTS}
    unknown = [*(bench.keys() - known), *(f"specimen.{key}" for key in specimen.keys() - {"action", "set"})]
    if unknown:
        raise RigInputError(f"{path}: unknown key {min(unknown)}; correct its spelling or remove it")
    for key, value in scatter.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= MOST_SCATTER:
            raise RigInputError(f"{path}: scatter.{key}: found {value!r}, allowed 0 to {MOST_SCATTER} (relative)")
    driven = MOTOR_DRIVE in choice.effects
    if driven and "motor" in bench:
        raise RigInputError(
            f"{path}: found [motor] beside [motor_drive], allowed one: a drive has its torque from itself"
        )
    torque = 1.0 if driven else bench_table(bench, "motor", path).get("torque_per_volt_nm")
    if isinstance(torque, bool) or not isinstance(torque, (int, float)) or not 0 < torque <= 100:
        raise RigInputError(f"{path}: motor.torque_per_volt_nm: found {torque!r}, allowed above 0 to 100 N m/V")
    action = choice.apply_to(given)
    if driven:
        torque = model.drive.static_torque_nm(action, choice, 1.0)
    for key in scatter:
        if key != "motor_gain":
            action[key]  # an unknown path is refused here, before anything moves
    return ActionPlant(
        action, choice, float(torque), scatter, int(bench.get("seed", 0)) if seed is None else int(seed), sample_rate_hz
    )
