"""What a log tells of a drive's circuit: the numbers of `model.drive.circuit` and of the arm, by least squares.

Residual of a short window: torque of the motor less inertia, friction, return spring and the tip's force. Covariance
from the residuals themselves, correlated as they are, and from what all samples share (scales, delays, softness).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.drive.circuit import LUMPS, SUBSTEPS, motor_torque
from model.drive.log import DriveLog, DriveOptions
from model.drive.windows import Windows
from model.errors import InputError

Array = NDArray[np.float64]
ARM = ("inertia", "joint_friction", "spring_stiffness", "preload_nm")
PER_AMPERE = len(LUMPS)  # place of the torque constant where the current was recorded
SLIP_RAD_PER_S = 0.02  # speed over which friction turns round
FAR = 10.0  # times the largest torque asked for: a limit that is never met
SPREAD = {"share": 1.5, "firmness": 1.5}  # of the logarithm, before the log is looked at; 4 for the others
DIFFERENCE = 1e-4
ROUNDS, SHORT, LAG = 40, 10, 15
WORTH = 150.0  # fall of the sum of squares from which a limit is believed: windows overlap some sixfold
U_SOFTNESS = 0.03
WIDE = (0.1, 1.0, 10.0, 10.0)  # of the arm, SI units: far beyond any, so that what does not show stays finite
UNEXPLAINED = 0.2  # share of the tip's torque that may be left
DETERMINED = 0.3  # relative standard uncertainty up to which a number counts as determined


@dataclass(frozen=True)
class LumpFit:
    """Numbers found in a log.

    Attributes
    ----------
    names : of `circuit.LUMPS`, and ``torque_constant`` where the current was recorded
    value : (p,) of them
    covariance : (p, p) of their logarithms
    determined : (p,) whether the log says anything of each
    arm : inertia, friction, spring, preload of the arm, with standard uncertainty, in SI units
    asked_nm : largest torque the command asked for
    rms_nm : of the residuals
    """

    names: tuple[str, ...]
    value: Array
    covariance: Array
    determined: NDArray[np.bool_]
    arm: dict[str, tuple[float, float]]
    asked_nm: float
    rms_nm: float


class _Problem:
    """Averages of a log under its windows, and residuals of any numbers."""

    def __init__(self, log: DriveLog, options: DriveOptions) -> None:
        self.log, self.options = log, options
        self.windows = Windows(log.interval_s)
        self.speed = self.windows.speed(log.arm_rad)
        tip = options.length_m * log.force_n * np.cos(log.arm_rad)
        mean = self.windows.averages
        self.tip, self.tip_rate = mean(tip), mean(tip, 1)
        slip = mean(np.tanh(self.speed / SLIP_RAD_PER_S))
        turn = mean(log.arm_rad, 2)
        self.arm = np.stack([-turn, -slip, -mean(log.arm_rad), np.ones_like(turn)])  # of what the residual is linear in
        self.turn_rate = mean(log.arm_rad, 3)
        self.turning = mean(log.arm_rad, 1)
        self.asked = mean(log.command_v)
        self.current = log.current_a  # its samples need no window: nothing of it is differentiated
        fixed = {"share"} if options.mode == "voltage" else set()
        self.free = np.array([name not in fixed for name in LUMPS] + [True] * (self.current is not None))
        self.scale = np.ones(2)

    def torque(self, logs: Array, softness: float | None = None) -> Array:
        """Torque (p, k) at the samples and between them for rows of logarithms."""
        lumps = np.exp(logs[:, : len(LUMPS)])
        share = self.options.softness if softness is None else softness
        args = self.log.command_v, self.log.arm_rad, self.log.interval_s, self.options.mode, share
        return motor_torque(lumps, *args)

    def rows(self, logs: Array, arm: Array, torque: Array) -> Array:
        """Residuals of torque (p, m), then of current (p, n), in units of their scatter."""
        out = [(self.windows.averages(torque, parts=SUBSTEPS) + arm @ self.arm - self.tip) / self.scale[0]]
        if self.current is not None:
            out.append((torque[:, ::SUBSTEPS] * np.exp(-logs[:, PER_AMPERE])[:, None] - self.current) / self.scale[1])
        return np.concatenate(out, axis=1)

    def linearised(self, x: Array) -> tuple[Array, Array]:
        """Residuals and Jacobian at logarithms and numbers of the arm."""
        p = len(self.free)
        steps = DIFFERENCE * np.eye(p)[self.free]
        logs = np.concatenate([x[None, :p], x[:p] + steps, x[:p] - steps])
        found = self.rows(logs, x[p:], self.torque(logs))
        k = len(steps)
        jacobian = np.zeros((found.shape[1], len(x)))
        jacobian[:, np.flatnonzero(self.free)] = ((found[1 : k + 1] - found[k + 1 :]) / (2.0 * DIFFERENCE)).T
        jacobian[: self.arm.shape[1], p:] = (self.arm / self.scale[0]).T
        return found[0], jacobian


def fit_lumps(log: DriveLog, options: DriveOptions) -> LumpFit:
    """The numbers under which the log's torques balance best.

    Raises
    ------
    InputError : force and motion are not those of an arm that this command drives
    """
    problem = _Problem(log, options)
    starts = _starts(problem)
    x, prior = _search(problem, starts[0], starts[0], SHORT)[0], starts[0]
    _scatter(problem, x)
    found = [_search(problem, start, start, ROUNDS) for start in starts]
    best = min(range(len(found)), key=lambda k: found[k][1] + WORTH * (k > 0))
    x, prior = found[best][0], starts[best]
    for _ in range(2):  # scatter and numbers in turn
        _scatter(problem, x)
        x, _ = _search(problem, x, prior, ROUNDS)
    left = float(problem.scale[0] / np.sqrt(np.mean(problem.tip**2)))
    if left > UNEXPLAINED:
        raise InputError(
            f"log: command and motion leave {100 * left:.0f} % of the tip's torque unexplained, allowed "
            f"{100 * UNEXPLAINED:.0f} %; check clocks, signs, units and the mode of the amplifier"
        )
    return _result(problem, x)


def _scatter(problem: _Problem, x: Array) -> None:
    """Set the scatter of both kinds of residual to what it is at ``x``."""
    rest, m = problem.linearised(x)[0], problem.arm.shape[1]
    for k, part in enumerate((rest[:m], rest[m:])):
        if len(part):
            problem.scale[k] = max(problem.scale[k] * float(np.sqrt(np.mean(part**2))), 1e-12)


def _starts(problem: _Problem) -> list[Array]:
    """Where the search begins: from a straight line through small commands, with limits met and not."""
    log, mode = problem.log, problem.options.mode
    small = np.abs(problem.asked) <= 0.4 * np.abs(log.command_v).max()
    rows = np.concatenate([problem.asked[None], problem.arm, -problem.turning[None]])
    line = np.linalg.lstsq(rows[:, small].T, problem.tip[small], rcond=None)[0]
    gain = float(line[0])
    if np.ptp(problem.tip) == 0.0 or not gain > 0.0:
        raise InputError(
            "log: force and motion do not rise with the command; allowed force_n positive where the tip presses, "
            "arm_rad and command_v rising where it goes down, all on one clock"
        )
    asked = gain * float(np.abs(log.command_v).max())
    made = float(np.quantile(np.abs(problem.tip + max(line[1], 0.0) * -problem.arm[0]), 0.98))
    delay, firmness = (3e-4, 5.0) if mode == "torque" else (2e-3, 50.0)
    share = 0.1 if mode == "torque" else 1.0
    per_ampere = []
    if problem.current is not None:
        slope = float(problem.current @ log.command_v / (log.command_v @ log.command_v))
        per_ampere = [gain / max(abs(slope), 1e-6)]
    out = []
    for ceiling in (FAR * asked, min(made, asked)):
        for supply in (FAR * asked, 1.2 * asked, 0.5 * asked):
            lumps = [gain, delay, max(float(line[-1]), 1e-3), ceiling, supply, share, firmness, *per_ampere]
            out.append(np.concatenate([np.log(lumps), [max(line[1], 1e-5), max(line[2], 0.0), line[3], line[4]]]))
    return out


def _prior(problem: _Problem) -> Array:
    """Weights (k,) that hold what the log does not say near where the search began."""
    logs = [1.0 / SPREAD.get(name, 4.0) for name in (*LUMPS, "torque_constant")][: len(problem.free)]
    return np.array([*logs, *(1.0 / wide for wide in WIDE)])


def _search(problem: _Problem, x: Array, prior: Array, rounds: int) -> tuple[Array, float]:
    """Levenberg-Marquardt from ``x``; what it finds and the sum of squares there."""
    weight, damping = _prior(problem) ** 2, 1e-3
    moving = np.concatenate([problem.free, np.ones(len(ARM), dtype=bool)])
    rest, jacobian = problem.linearised(x)
    cost = float(rest @ rest + weight @ (x - prior) ** 2)
    for _ in range(rounds):
        normal = jacobian.T @ jacobian + np.diag(weight)
        slope = jacobian.T @ rest + weight * (x - prior)
        size = np.diag(normal) + 1e-12 * np.diag(normal).max()
        step = np.zeros_like(x)
        held = (normal + damping * np.diag(size))[np.ix_(moving, moving)]
        step[moving] = -np.linalg.lstsq(held, slope[moving], rcond=None)[0]
        step[: len(problem.free)] = np.clip(step[: len(problem.free)], -0.7, 0.7)
        tried = x + step
        rest_new, jacobian_new = problem.linearised(tried)
        cost_new = float(rest_new @ rest_new + weight @ (tried - prior) ** 2)
        if cost_new < cost:
            done = cost - cost_new < 1e-9 * cost
            x, cost, rest, jacobian, damping = tried, cost_new, rest_new, jacobian_new, 0.2 * damping
            if done:
                break
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    return x, cost


def _result(problem: _Problem, x: Array) -> LumpFit:
    """Numbers with their covariance, from the residuals and from what all samples share."""
    p, m = len(problem.free), problem.arm.shape[1]
    rest, jacobian = problem.linearised(x)
    weight = _prior(problem) ** 2
    moving = np.flatnonzero(np.concatenate([problem.free, np.ones(len(ARM), dtype=bool)]))
    inverse = np.linalg.pinv((jacobian.T @ jacobian + np.diag(weight))[np.ix_(moving, moving)], rcond=1e-15)
    jacobian = jacobian[:, moving]
    scatter = np.diag(weight)[np.ix_(moving, moving)]
    pushes = jacobian * rest[:, None]
    for part in (pushes[:m], pushes[m:]):
        scatter = scatter + part.T @ part
        for lag in range(1, LAG + 1):
            cross = part[lag:].T @ part[:-lag]
            scatter = scatter + (1.0 - lag / (LAG + 1.0)) * (cross + cross.T)
    covariance = inverse @ scatter @ inverse
    for wrong in _shared(problem, x):
        shift = inverse @ (jacobian.T @ wrong)
        covariance = covariance + np.outer(shift, shift)
    whole = np.zeros((len(x), len(x)))
    whole[np.ix_(moving, moving)] = covariance
    spread = np.array([SPREAD.get(name, 4.0) for name in (*LUMPS, "torque_constant")][:p])
    u = np.sqrt(np.maximum(np.diag(whole), 0.0))
    names = (*LUMPS, "torque_constant")[:p]
    bare = np.zeros(p)
    bare[moving[: len(moving) - len(ARM)]] = np.linalg.norm(jacobian[:, : len(moving) - len(ARM)], axis=0)
    determined = problem.free & (u[:p] < min(DETERMINED, 1.0)) & (u[:p] < 0.5 * spread) & (bare > 3.0)
    asked = float(np.exp(x[0]) * np.abs(problem.log.command_v).max())
    arm = {name: (float(x[p + k]), float(u[p + k])) for k, name in enumerate(ARM)}
    rms = float(problem.scale[0] * np.sqrt(np.mean(rest[:m] ** 2)))
    return LumpFit(names, np.exp(x[:p]), whole[:p, :p], determined, arm, asked, rms)


def _shared(problem: _Problem, x: Array) -> list[Array]:
    """Errors of the residuals by one standard uncertainty of each thing that all samples share."""
    o, p = problem.options, len(problem.free)
    torque = problem.torque(x[None, :p])[0]
    blank = np.zeros_like(torque[::SUBSTEPS])
    still = np.zeros_like(problem.tip)
    scale = float(np.hypot(o.u_force, o.u_length_m / o.length_m))
    known = [(-scale * problem.tip, blank), (o.u_delay_s * problem.tip_rate, blank)]
    known.append((o.u_delay_s * x[p] * problem.turn_rate, blank))
    softer = problem.torque(x[None, :p], min(o.softness + U_SOFTNESS, 0.5))[0] - torque
    k = np.exp(-x[PER_AMPERE]) if problem.current is not None else 0.0
    known.append((problem.windows.averages(softer, parts=SUBSTEPS), k * softer[::SUBSTEPS]))
    if problem.current is not None:
        known.append((still, -o.u_current * problem.current))
    out = []
    for force, current in known:
        parts = [force / problem.scale[0]] + ([current / problem.scale[1]] if problem.current is not None else [])
        out.append(np.concatenate(parts))
    return out
