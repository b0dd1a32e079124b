"""Least-squares fit of a motor drive's lumped parameters to a log of its torque, current and motion.

With m = k i the torque, D the resistance R plus the gain of the current loop Z:

    delay dm/dt = S(source - (1 - share) m - firmness (m - lim(m))) - share m - damping w,

torque_per_volt = k g (torque mode) or k g / D (voltage mode), delay = L / D, damping = k^2 / D, ceiling = k I (lim),
supply = U k / D (S), share = R / D, which is 1 in voltage mode, firmness = limit_gain / D. Nothing else of the drive
shows in a torque. Force, torque and acceleration are compared by their averages under the same short windows, so that
nothing is differentiated and noise of an encoder enters as it is.

Residual of a window: torque of the motor less inertia, friction, return spring and the tip's force. Covariance
from the residuals themselves, correlated as they are, and from what all samples share (scales, delays, softness).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from model.codegen.load import load_kernel
from model.drive.log import DriveLog, DriveOptions
from model.errors import InputError
from model.kernels.drive_torque import SUBSTEPS, integrate_torque
from model.scene.pressing import SATURATED

Array = NDArray[np.float64]
LUMPS = ("torque_per_volt", "delay", "damping", "ceiling", "supply", "share", "firmness")
DEGREE = 5  # of the bump: its third derivative is continuous
QUARTIC = np.array([22.0, -67.0, -58.0, 0.0, 58.0, 67.0, -22.0]) / 252.0
PIECE = 3  # samples a piece of the bump: choice, a window of 18 averages an encoder's rounding
ARM = ("inertia", "joint_friction", "spring_stiffness", "preload_nm")
PER_AMPERE = len(LUMPS)  # place of the torque constant where the current was recorded
SLIP_RAD_PER_S = 0.02  # over which friction turns round: choice, slow against any stroke
UNREACHED_LIMIT = 10.0  # times the largest torque asked for: a limit that is never met
LOG_PRIOR_WIDTH, HARDLY_SEEN_WIDTH = 4.0, 1.5  # of a logarithm before the log is looked at; of share and firmness
DIFFERENCE = 1e-4  # of a logarithm, of the central differences: exact to 1e-8, far above rounding
MOST_EVALUATIONS = 40  # of the residuals in a search
LAG = 15  # windows of 3 samples beyond which residuals count as independent: choice, 45 samples
LEAST_IMPROVEMENT = 150.0  # fall of the sum of squares from which a limit is believed: windows overlap some sixfold
U_SOFTNESS = 0.03  # of `motor_drive.limit_softness`, as its source states
ARM_PRIOR_WIDTH = 10.0  # of the arm, SI units: far beyond any, so that what does not show stays finite
UNEXPLAINED = 0.2  # share of the tip's torque that may be left: choice, wrong clocks or signs leave most of it
DETERMINED = 0.3  # relative standard uncertainty up to which a number is given: choice, one digit
SEEN = 3.0  # standard deviations of the residuals that a number must change: at less, the log is silent about it
SMALLEST_INERTIA = 1e-5  # kg m^2, far below any arm: a start above 0
CURRENT_LOOP, WINDING = (3e-4, 5.0, 0.1), (2e-3, 50.0, 1.0)  # delay, s, firmness, share of usual drives, to start from


def motor_torque(
    lumps: Array, command_v: Array, arm_rad: Array, interval_s: float, mode: str, softness: float
) -> Array:
    """Torque (p, k), N m, at the samples of ``command_v`` and `SUBSTEPS` - 1 times between, for rows (p, 7) as
    ``LUMPS``; ``mode``: torque or voltage; ``softness``: of the limits of current and supply.

    The command is held from sample to sample; the motor begins as if its first command had lasted. Of the motion only
    angles are taken: the back-EMF of a substep is what the arm turned in it, so that nothing is differentiated.
    """
    rows = np.ascontiguousarray(lumps, dtype=float)
    largest = rows[:, 3] if mode == "torque" else SATURATED * rows[:, 4]
    out = np.empty((len(rows), (len(command_v) - 1) * SUBSTEPS + 1))
    turned = _interpolate(arm_rad, SUBSTEPS)
    integrate_torque(
        load_kernel((), "amplifier"), rows, np.ascontiguousarray(largest), command_v, turned, interval_s, softness, out
    )
    return out


def _interpolate(x: Array, parts: int) -> Array:
    """``x`` (n,) with ``parts`` - 1 values between each two samples, ((n - 1) parts + 1,), by cubics through four of
    them."""
    slope = 0.5 * np.diff(np.concatenate([[2.0 * x[0] - x[1]], x, [2.0 * x[-1] - x[-2]]]))
    slope = slope[:-1] + slope[1:]
    at = (np.arange(parts) / parts)[None, :]
    left, right, rise, fall = x[:-1, None], x[1:, None], slope[:-1, None], slope[1:, None]
    cubic = (1 + 2 * at) * (1 - at) ** 2 * left + at**2 * (3 - 2 * at) * right
    cubic += at * (1 - at) ** 2 * rise + at**2 * (at - 1) * fall
    return np.append(cubic.ravel(), x[-1])


@dataclass(frozen=True)
class Windows:
    """Bumps of 18 samples, one every ``PIECE`` samples."""

    interval_s: float  # of the samples

    def averages(self, x: Array, rates: int = 0, parts: int = 1) -> Array:
        """Average (m,) of the derivative of order ``rates`` of ``x`` (n,), or of each row (p, n), under each window;
        ``x`` has ``parts`` values to a sample interval.

        With ``parts`` there are that many values to a sample interval: sums over the samples of a torque that has a
        kink at each of them would be off its integral, by an apparent delay of a twelfth of the interval's square over
        the drive's own.
        """
        step = self.interval_s / parts
        bump = BSpline.basis_element(np.arange(DEGREE + 2) * PIECE * self.interval_s)
        at = np.arange(1, (DEGREE + 1) * PIECE * parts) * step
        weights = (-1.0) ** rates * bump.derivative(rates)(at) if rates else bump(at)
        weights = weights / np.sum(bump(at))
        rows = np.pad(np.atleast_2d(x), ((0, 0), (parts - 1, parts - 1)), mode="edge")
        count = ((np.shape(x)[-1] - 1) // parts + 1 - (DEGREE + 1) * PIECE + 1) // PIECE + 1
        out = np.stack([np.convolve(row, weights[::-1], "valid")[:: PIECE * parts] for row in rows])[:, :count]
        return out[0] if np.ndim(x) == 1 else out

    def speed(self, x: Array) -> Array:
        """Rate (n,) of ``x`` at its samples: slope of a quartic through seven of them, which keeps what rings."""
        slope = np.convolve(np.pad(x, 3, mode="edge"), QUARTIC[::-1], "valid")
        return np.asarray(slope / self.interval_s)


@dataclass(frozen=True)
class LumpFit:
    """Numbers found in a log."""

    names: tuple[str, ...]  # of `circuit.LUMPS`, and ``torque_constant`` where the current was recorded
    value: Array  # (p,) of them
    covariance: Array  # (p, p) of their logarithms
    determined: NDArray[np.bool_]  # (p,) whether the log says anything of each
    # inertia, friction, spring, preload of the arm, with standard uncertainty, in SI units
    arm: dict[str, tuple[float, float]]
    asked_nm: float  # largest torque the command asked for
    rms_nm: float  # of the residuals


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

    def residuals(self, x: Array) -> Array:
        """Residuals at logarithms and numbers of the arm, (r,)."""
        logs = x[None, : len(self.free)]
        return self.rows(logs, x[len(self.free) :], self.torque(logs))[0]

    def jacobian(self, x: Array) -> Array:
        """Derivatives (r, k) of `residuals` by ``x`` (k,): logarithms of the lumps, by central differences, then the
        arm's parameters in SI units."""
        p = len(self.free)
        steps = DIFFERENCE * np.eye(p)[self.free]
        logs = np.concatenate([x[:p] + steps, x[:p] - steps])
        more, less = np.split(self.rows(logs, x[p:], self.torque(logs)), 2)
        jacobian = np.zeros((more.shape[1], len(x)))
        jacobian[:, np.flatnonzero(self.free)] = ((more - less) / (2.0 * DIFFERENCE)).T
        jacobian[: self.arm.shape[1], p:] = (self.arm / self.scale[0]).T
        return jacobian


def fit_lumps(log: DriveLog, options: DriveOptions) -> LumpFit:
    """Fit lumped parameters of motor, amplifier and arm, with covariance, so that the log's torques balance;
    `InputError` where they leave much unexplained."""
    problem = _Problem(log, options)
    starts = _initial_guesses(problem)
    x, prior = _fit_least_squares(problem, starts[0], starts[0], MOST_EVALUATIONS)[0], starts[0]
    _set_residual_scale(problem, x)
    found = [_fit_least_squares(problem, start, start, MOST_EVALUATIONS) for start in starts]
    best = min(range(len(found)), key=lambda k: found[k][1] + LEAST_IMPROVEMENT * (k > 0))
    x, prior = found[best][0], starts[best]
    for _ in range(2):  # scatter and numbers in turn
        _set_residual_scale(problem, x)
        x, _ = _fit_least_squares(problem, x, prior, MOST_EVALUATIONS)
    left = float(problem.scale[0] / np.sqrt(np.mean(problem.tip**2)))
    if left > UNEXPLAINED:
        raise InputError(
            f"log: command and motion leave {100 * left:.0f} % of the tip's torque unexplained, allowed "
            f"{100 * UNEXPLAINED:.0f} %; check clocks, signs, units and the mode of the amplifier"
        )
    return _lump_fit(problem, x)


def _set_residual_scale(problem: _Problem, x: Array) -> None:
    rest, m = problem.residuals(x), problem.arm.shape[1]
    for k, part in enumerate((rest[:m], rest[m:])):
        if len(part):
            problem.scale[k] = max(problem.scale[k] * float(np.sqrt(np.mean(part**2))), 1e-12)


def _initial_guesses(problem: _Problem) -> list[Array]:
    """Start vectors (k,) of the search (logarithms of lumps, then the arm's), from a line fitted at small commands,
    with limits reached and not."""
    log, mode = problem.log, problem.options.mode
    # small commands, at which no limit is met yet
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
    # torque that only a spike exceeds
    made = float(np.quantile(np.abs(problem.tip + max(line[1], 0.0) * -problem.arm[0]), 0.98))
    delay, firmness, share = CURRENT_LOOP if mode == "torque" else WINDING
    per_ampere = []
    if problem.current is not None:
        slope = float(problem.current @ log.command_v / (log.command_v @ log.command_v))
        per_ampere = [gain / max(abs(slope), 1e-6)]
    out = []
    for ceiling in (UNREACHED_LIMIT * asked, min(made, asked)):
        for supply in (UNREACHED_LIMIT * asked, 1.2 * asked, 0.5 * asked):  # not met, just met, met for most of it
            lumps = [gain, delay, max(float(line[-1]), 1e-3), ceiling, supply, share, firmness, *per_ampere]
            arm = [max(line[1], SMALLEST_INERTIA), max(line[2], 0.0), line[3], line[4]]
            out.append(np.concatenate([np.log(lumps), arm]))
    return out


def _prior(problem: _Problem) -> Array:
    """Weights (k,) of the prior, which holds undetermined parameters near the start of the search."""
    return 1.0 / np.append(_log_prior_widths(problem), [ARM_PRIOR_WIDTH] * len(ARM))


def _log_prior_widths(problem: _Problem) -> Array:
    names = (*LUMPS, "torque_constant")[: len(problem.free)]
    return np.array([HARDLY_SEEN_WIDTH if name in ("share", "firmness") else LOG_PRIOR_WIDTH for name in names])


def _free_indices(problem: _Problem) -> NDArray[np.int64]:
    return np.flatnonzero(np.concatenate([problem.free, np.ones(len(ARM), dtype=bool)]))


def _fit_least_squares(problem: _Problem, x: Array, prior: Array, max_evaluations: int) -> tuple[Array, float]:
    """Weighted least squares of misfit and prior from ``x`` (k,): best (k,), and its sum of squares, prior included."""
    weight, moving = _prior(problem), _free_indices(problem)
    hold = np.diag(weight)[:, moving]

    def full_vector(moved: Array) -> Array:
        out = x.copy()
        out[moving] = moved
        return out

    found = least_squares(
        lambda y: np.concatenate([problem.residuals(full_vector(y)), weight * (full_vector(y) - prior)]), x[moving],
        jac=lambda y: np.concatenate([problem.jacobian(full_vector(y))[:, moving], hold]),
        x_scale="jac", ftol=1e-9, max_nfev=max_evaluations,
    )  # fmt: skip
    return full_vector(found.x), 2.0 * float(found.cost)


def _lump_fit(problem: _Problem, x: Array) -> LumpFit:
    """Result at the best ``x``: numbers, with their covariance from the residuals, correlated as they are, and from
    errors that all samples share, and which of them the log determines."""
    p, m = len(problem.free), problem.arm.shape[1]
    rest, jacobian = problem.residuals(x), problem.jacobian(x)
    weight = _prior(problem) ** 2
    moving = _free_indices(problem)
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
    for wrong in _common_error_columns(problem, x):
        shift = inverse @ (jacobian.T @ wrong)
        covariance = covariance + np.outer(shift, shift)
    whole = np.zeros((len(x), len(x)))
    whole[np.ix_(moving, moving)] = covariance
    u = np.sqrt(np.maximum(np.diag(whole), 0.0))
    names = (*LUMPS, "torque_constant")[:p]
    bare = np.zeros(p)
    bare[moving[: len(moving) - len(ARM)]] = np.linalg.norm(jacobian[:, : len(moving) - len(ARM)], axis=0)
    determined = problem.free & (u[:p] < DETERMINED) & (bare > SEEN)
    asked = float(np.exp(x[0]) * np.abs(problem.log.command_v).max())
    arm = {name: (float(x[p + k]), float(u[p + k])) for k, name in enumerate(ARM)}
    rms = float(problem.scale[0] * np.sqrt(np.mean(rest[:m] ** 2)))
    return LumpFit(names, np.exp(x[:p]), whole[:p, :p], determined, arm, asked, rms)


def _common_error_columns(problem: _Problem, x: Array) -> list[Array]:
    """Shifts (r,) of the residuals at ``x`` by one standard uncertainty of each error that all samples share: scale of
    force and lever, delay, softness of limits, scale of current."""
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
