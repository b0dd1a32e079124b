"""Motion-driven simulation: a measured motion of key, arm or finger goes in, the force that it takes comes out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from model.arrays import ArrayRecord, as_numbers
from model.errors import InputError
from model.files.force_table import LARGEST_FORCE_N
from model.force_driven import check_output_times
from model.keywords import make_options
from model.motion_driven.prescribed_key import PrescribedRun, rest_angle, run_prescribed
from model.motion_driven.spline_fit import LARGEST_U_RAD, KeyFit, fit_key_motion
from model.parameters.action import Action, ActionLike, as_action
from model.parameters.effects import KEY_LIFT, column
from model.scene.key_motion import KeyMotion
from model.scene.selection import check_prescribed
from model.simulation.compliant_joints import CompliantJointMotion
from model.simulation.loads_and_losses import RailTension, tensions
from model.simulation.options import SimulationKeywords, SimulationOptions
from model.simulation.solution import Moved
from model.simulation.string_motion import StringMotion
from model.tolerance import MOTION_TOLERANCE

Array = NDArray[np.float64]


class MotionDrivenKeywords(SimulationKeywords, total=False):
    """Keywords of a motion-driven simulation; see `MotionDrivenOptions`."""

    resolution_rad: float | None
    jitter_rad: float | None
    from_rest: bool
    u_zero_rad: float
    members: int
    seed: int
    share: Callable[..., Iterable[PrescribedRun]]


UPPER = 0.975  # of Student's t: both ends of an interval of 95 %


@dataclass(frozen=True)
class MotionDrivenOptions(SimulationOptions):
    """How to simulate under a motion of the key, and what is known of its angles; see `simulate_motion`."""

    tolerance: float = MOTION_TOLERANCE
    resolution_rad: float | None = None
    jitter_rad: float | None = None
    from_rest: bool = False
    u_zero_rad: float = 0.0
    members: int = 40  # a standard deviation of them is known to 11 %
    seed: int = 0
    share: Callable[..., Iterable[PrescribedRun]] = map

    def __post_init__(self) -> None:
        if self.members < 0 or self.members == 1:
            raise InputError(f"members of the ensemble: found {self.members}, allowed 0 or from 2")
        if not 0.0 <= self.u_zero_rad <= LARGEST_U_RAD:
            limit = f"allowed 0 to {LARGEST_U_RAD:g}"
            raise InputError(f"uncertainty of the zero: found {self.u_zero_rad:g} rad, {limit}")


@dataclass(frozen=True)
class MotionDriven(Moved, ArrayRecord):
    """The force that a motion of the key takes, and the motion of the other bodies.

    Attributes
    ----------
    bodies : names of the columns
    time_s : (m,)
    force_n : (m,) force at the key front, N, positive downwards
    u_force_n : (m,) its standard uncertainty, N: what the measured angle leaves open, nothing of the model
    coverage_factor : `force_n` +- coverage_factor x `u_force_n` covers 95 %
    angle_rad, speed_rad_per_s : (m, n) of all bodies, the key as fitted
    u_angle_rad : (m, n)
    key_rad_per_s2 : (m,) acceleration of the key
    rest_rad : angle of the key of this action at rest without a force
    rail_n : (m,) force of the balance rail on the key, N, upwards
    lifted : (m,) True where the rail would have to pull; neither force nor uncertainty are valid there. Nowhere in a
        scene whose key lifts
    fit : the motion that was fitted
    counters : steps, rejections and so on of the run under the fitted motion
    tolerance : requested largest error of any angle, rad
    arm_m : length of the motor's arm or of the finger where their angle is prescribed: `force_n` is then the torque on
        that joint over it, and "key" above means that arm; None of a key
    string, give, action : the string's motion, what joints give and the parameter set, as of a `Solution`
    """

    bodies: tuple[str, ...]
    time_s: Array
    force_n: Array
    u_force_n: Array
    coverage_factor: float
    angle_rad: Array
    speed_rad_per_s: Array
    u_angle_rad: Array
    key_rad_per_s2: Array
    rest_rad: float
    rail_n: Array
    lifted: NDArray[np.bool_]
    fit: KeyFit
    counters: dict[str, int | float] = field(default_factory=dict)
    tolerance: float = MOTION_TOLERANCE
    arm_m: float | None = None
    string: StringMotion | None = None
    give: CompliantJointMotion | None = None
    action: Action | None = field(default=None, repr=False, compare=False)

    def key_tensions(self) -> list[RailTension]:
        """Intervals in which the balance rail would have to pull the key down: predicted lift."""
        return tensions(self.time_s, np.where(self.lifted, self.rail_n, np.abs(self.rail_n)))

    def half_width_share(self) -> float:
        """Half the 95 % interval of the force as a share of it, the larger of two: at the largest force, and rms over
        rms; without samples where the key would lift; NaN without an ensemble.

        From 0.5 the force says next to nothing.
        """
        half, force = (a[~self.lifted] for a in (self.coverage_factor * self.u_force_n, np.abs(self.force_n)))
        if not len(force) or not np.max(force) > 0.0:
            return float("nan")
        rms = float(np.sqrt(np.mean(half**2) / np.mean(force**2)))
        return max(rms, float(half[np.argmax(force)] / np.max(force)))

    def columns(self) -> dict[str, Array]:
        """Columns of the output file in order: ``time_s``, ``force_n``, ``u_force_n``, (``torque_nm``,)
        ``key_joint_y_n``, ``key_lifted``, angles (rad), speeds (rad/s) by body, then string and joints."""
        out = {"time_s": self.time_s, "force_n": self.force_n, "u_force_n": self.u_force_n}
        if self.arm_m is not None:
            out["torque_nm"] = self.arm_m * self.force_n
        out |= {"key_joint_y_n": self.rail_n, "key_lifted": self.lifted.astype(float)}
        out |= {column(body): self.angle_rad[:, i] for i, body in enumerate(self.bodies)}
        out |= {column(body, rate=True): self.speed_rad_per_s[:, i] for i, body in enumerate(self.bodies)}
        return out | self.string_and_joint_columns()


def simulate_motion(
    action: ActionLike, time_s: ArrayLike, key_rad: ArrayLike, **keywords: Unpack[MotionDrivenKeywords]
) -> MotionDriven:
    """Predict the force at the key front, N, and the other bodies' motion, from the key's measured angle, rad from
    ground, counter-clockwise (``from_rest``: since rest).

    Parameters
    ----------
    action : parameter set
    time_s, key_rad : (n,) increasing times and measured angles of the key (from ground, counter-clockwise; at rest the
        rest angle of the action); NaN where an angle is lost. Where the scene's key lifts or its joint gives: of its
        front, the angle at which a key on its pivot would have it there. With a motor arm or a finger: of that
    tolerance : requested largest error of any angle, rad; by default 1e-6
    output_time_s : (m,) increasing, within the table; by default the table's own times
    scene : what takes part, by name or file (`model.scene.selection`)
    method : integration method by name (`model.integrators.methods`)
    from_rest : the angles are changes since rest, as an incremental encoder gives them: the rest angle is added, and
        the rounding of the encoder's zero to its uncertainty
    resolution_rad, jitter_rad : width of a count and standard deviation beyond it; by default estimated from the angles
    u_zero_rad : standard uncertainty of the angles' common zero
    members : size of the seeded ensemble that carries the uncertainty from the angle to the force, by default 40; 0
        leaves it out (``u_force_n`` is NaN)
    seed : of the ensemble
    share : ``map``, or the ``map`` of an executor that distributes the ensemble over threads

    Returns
    -------
    MotionDriven
        Force (m,), N, with its standard uncertainty, and the motion of all bodies.

    Raises
    ------
    InputError : table, times or tolerance cannot be used
    IntegrationError, StaticsError : the action cannot follow this motion

    Notes
    -----
    The ensemble draws whole motions from the posterior of the fit (`KeyFit.draw`), so that ``u_force_n`` contains all
    of angle, speed and acceleration and what the other bodies make of them: it is the root mean square departure of
    the members from ``force_n``. It is what the angle leaves open under this model, not how right the model is. Noise
    of the force from sample to sample moves the key by less than a count: it is neither in the force nor in its
    uncertainty. Errors persist: one draw at an impact can shift the force of a whole hold. Equations: thesis Chapter 2.

    Examples
    --------
    >>> import model
    >>> time_s, key_rad = model.read_motion_table("key.csv")
    >>> driven = model.simulate_motion(model.load_action(), time_s, key_rad, from_rest=True, members=4)
    >>> driven.force_n.shape == driven.u_force_n.shape == time_s.shape
    True
    """
    action = as_action(action)
    options = make_options(MotionDrivenOptions, "model.simulate_motion", keywords)
    action, choice = options.resolve(action)
    check_prescribed(choice)  # before the rest angle, for which the scene's kernels may have to be compiled
    rest = rest_angle(action, choice)
    if options.from_rest:
        key_rad = as_numbers(key_rad, "key motion") + rest
    fit = fit_key_motion(time_s, key_rad, resolution_rad=options.resolution_rad, jitter_rad=options.jitter_rad)
    outputs = check_output_times(options.output_time_s, fit.time_s)
    if len(outputs) == 0:
        raise InputError("output times: found none, allowed at least one")

    def run(motion: KeyMotion) -> PrescribedRun:
        return run_prescribed(
            action, motion, outputs, tolerance=options.tolerance, choice=choice, method=options.method
        )

    motion = fit.motion()
    mean = run(motion)
    largest = int(np.argmax(np.abs(mean.force_n)))
    if not abs(mean.force_n[largest]) <= LARGEST_FORCE_N:
        raise InputError(
            f"key motion: takes {mean.force_n[largest]:.0f} N at {outputs[largest]:g} s, allowed up to "
            f"{LARGEST_FORCE_N:g} N; check unit and zero of the angles (at rest {rest:.5f} rad, or changes from rest)"
        )
    u_force, u_angle = _ensemble_deviation(run, fit, mean, options)
    return MotionDriven(
        bodies=mean.bodies,
        time_s=outputs,
        force_n=mean.force_n,
        u_force_n=u_force,
        coverage_factor=float(stdtrit(options.members, UPPER)) if options.members else float("nan"),
        angle_rad=mean.angle_rad,
        speed_rad_per_s=mean.speed_rad_per_s,
        u_angle_rad=u_angle,
        key_rad_per_s2=motion.evaluate(outputs)[:, 2],
        rest_rad=rest,
        rail_n=mean.rail_n,
        lifted=(mean.rail_n < 0.0) & (KEY_LIFT not in mean.bodies),
        fit=fit,
        counters=mean.counters,
        tolerance=options.tolerance,
        arm_m=mean.arm_m,
        string=mean.string,
        give=mean.give,
        action=action,
    )


def _ensemble_deviation(
    run: Callable[[KeyMotion], PrescribedRun], fit: KeyFit, mean: PrescribedRun, options: MotionDrivenOptions
) -> tuple[Array, Array]:
    """Root mean square departure of force (m,) and angles (m, n) from ``mean``, of motions drawn from ``fit`` (as many
    as ``options.members``) and simulated by ``run``; NaN without any."""
    force_square, angle_square = np.zeros(mean.force_n.shape), np.zeros(mean.angle_rad.shape)
    if not options.members:
        return force_square * np.nan, angle_square * np.nan
    random = np.random.default_rng(options.seed)
    u_zero = float(np.hypot(options.u_zero_rad, fit.resolution_rad / np.sqrt(12.0) if options.from_rest else 0.0))
    for member in options.share(run, [fit.draw(random, u_zero) for _ in range(options.members)]):
        force_square += (member.force_n - mean.force_n) ** 2
        angle_square += (member.angle_rad - mean.angle_rad) ** 2
    return np.sqrt(force_square / options.members), np.sqrt(angle_square / options.members)
