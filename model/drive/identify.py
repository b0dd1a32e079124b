"""Identify the parameters of a motor's drive from a log, and say which the log does not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.drive.log import GAIN, DriveLog, DriveOptions
from model.drive.lumps import DETERMINED, LumpFit, fit_lumps

Array = NDArray[np.float64]
LARGEST_U = {"joint_friction": 0.02, "spring_stiffness": 0.5, "preload_nm": 0.1}  # beyond, nothing was seen of it
RESISTANCE_SHARE = 0.05  # of the loop gain, at most: what it says of the sum of both
OPEN = 1e-6  # share of a direction that nothing fixes
COMBINATIONS = {
    "torque_per_volt": "N*m/V",
    "delay": "s",
    "damping": "N*m*s/rad",
    "ceiling": "N*m",
}
UNITS = {
    "resistance": "ohm",
    "inductance": "H",
    "torque_constant": "N*m/A",
    "current_gain": "A/V",
    "voltage_gain": "1",
    "loop_gain": "V/A",
    "resistance_and_loop_gain": "V/A",
    "supply": "V",
    "current_limit": "A",
}
NOT_MET = {
    "ceiling": "the motor never came near its largest current; ask for more torque",
    "supply": "the voltage never came near the supply; ask for faster steps of torque",
    "share": "only a loop that its supply holds back shows resistance and loop gain apart; ask for faster steps",
    "damping": "the arm never turned fast enough for its back-EMF to show; record a blow",
    "delay": "the command never changed fast enough; record steps",
}
NOT_SHOWN = "the log does not show it"
NEEDED = {
    "supply": ("supply",),
    "current_limit": ("ceiling",),
    "inductance": ("delay", "damping"),
    **dict.fromkeys(("resistance", "loop_gain", "resistance_and_loop_gain"), ("damping",)),
}
"""Lumps without which a number stays open, the first that is missing named."""
ARM_UNITS = {
    "inertia": "kg*m^2",
    "joint_friction": "N*m",
    "spring_stiffness": "N*m/rad",
    "preload_nm": "N*m",
}


@dataclass(frozen=True)
class Estimate:
    """A number with its standard uncertainty; where the log does not determine it both are NaN and ``why`` says so."""

    name: str
    value: float
    u: float
    unit: str
    why: str = ""

    @property
    def is_determined(self) -> bool:
        """Whether the log and the stated values determine the parameter."""
        return not self.why

    determined = is_determined  # former names, for one release


@dataclass(frozen=True)
class DriveIdentified:
    """A drive from its log.

    Attributes
    ----------
    mode : ``torque`` or ``voltage``
    drive : numbers of ``motor_drive`` in the order of its parameters
    combinations : what shows in a torque: torque per volt, delay, damping by back-EMF, largest torque
    arm : inertia, friction, spring and preload of rotor and arm
    rms_nm : what is left of the balance of torques, root mean square
    """

    mode: str
    drive: tuple[Estimate, ...]
    combinations: tuple[Estimate, ...]
    arm: tuple[Estimate, ...]
    rms_nm: float

    def __getitem__(self, name: str) -> Estimate:
        return next(e for e in (*self.drive, *self.combinations, *self.arm) if e.name == name)

    def lines(self) -> list[str]:
        """The result as lines of text."""
        out = []
        for title, items in (("drive", self.drive), ("combinations", self.combinations), ("arm", self.arm)):
            out.append(f"{title}:")
            for e in items:
                known = f"{e.value:.4g} {e.unit} (standard uncertainty {e.u:.2g})"
                words = known if e.is_determined else f"not determined: {e.why}"
                out.append(f"  {e.name:24s} {words}")
        return [*out, f"torques balance to {1e3 * self.rms_nm:.2g} mN m (root mean square)"]


def identify_drive(log: DriveLog, options: DriveOptions | None = None) -> DriveIdentified:
    """Estimate torque constant, gains, delay, limits and the arm's inertia, friction and spring of a bench from a log
    of command, force and motion, with standard uncertainties; a number that the log does not show has its reason.

    Parameters
    ----------
    log : one blow or several, with steps of the command if its delay is wanted
    options : mode of the amplifier, lever, uncertainties of the scales, what is known otherwise

    Returns
    -------
    DriveIdentified
        With standard uncertainties, and the names of numbers that the log does not determine.

    Raises
    ------
    InputError : a log or options that cannot be used

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> time_s, command_v = (column * factor for column, factor in zip(model.force_table("forte"), (1.0, 1 / 12)))
    >>> blow = model.simulate(
    ...     action, time_s, command_v, scene="motor-drive", output_time_s=time_s, contact_forces=True, tolerance=1e-7)
    >>> force_n = model.drive.drive_readings(action, blow, time_s, command_v).force_n
    >>> arm_rad = blow.angle_rad[:, blow.bodies.index("motor")]
    >>> found = model.drive.identify_drive(model.drive.DriveLog(time_s, command_v, force_n, arm_rad))
    >>> f"{found['torque_per_volt'].value:.2f} N m/V", found["torque_constant"].determined
    ('1.20 N m/V', False)
    """
    options = options or DriveOptions()
    fit = fit_lumps(log, options)
    u = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    shown = []
    for name, unit in COMBINATIONS.items():
        k = fit.names.index(name)
        why = "" if fit.determined[k] else NOT_MET.get(name, NOT_SHOWN)
        shown.append(_estimate(name, fit.value[k], u[k], unit, why))
    arm = tuple(_arm(name, value, u_value) for name, (value, u_value) in fit.arm.items())
    return DriveIdentified(options.mode, _physical_parameters(fit, options), tuple(shown), arm, fit.rms_nm)


def _estimate(name: str, value: float, relative: float, unit: str, why: str) -> Estimate:
    if why:
        return Estimate(name, np.nan, np.nan, unit, why)
    return Estimate(name, float(value), float(value * relative), unit)


def _arm(name: str, value: float, u: float) -> Estimate:
    if u > LARGEST_U.get(name, DETERMINED * abs(value)):
        return Estimate(name, np.nan, np.nan, ARM_UNITS[name], "the arm never moved enough for it")
    return Estimate(name, value, u, ARM_UNITS[name])


def _physical_parameters(fit: LumpFit, options: DriveOptions) -> tuple[Estimate, ...]:
    """Estimates of the drive's parameters by least squares: logarithms of the fitted combinations are sums of
    theirs."""
    voltage, gain = options.mode == "voltage", GAIN[options.mode]
    unknown = ["torque_constant", gain, "total", "inductance", "current_limit", "supply", "share"]
    sums: dict[str, dict[str, float]] = {
        "torque_per_volt": {"torque_constant": 1, gain: 1, **({"total": -1} if voltage else {})},
        "delay": {"inductance": 1, "total": -1},
        "damping": {"torque_constant": 2, "total": -1},
        "ceiling": {"torque_constant": 1, "current_limit": 1},
        "supply": {"supply": 1, "torque_constant": 1, "total": -1},
        "share": {"share": 1},
        "torque_constant": {"torque_constant": 1},
    }
    seen = [k for k, name in enumerate(fit.names) if fit.determined[k] and name in sums]
    rows = [sums[fit.names[k]] for k in seen]
    values = [float(np.log(fit.value[k])) for k in seen]
    known = [({"share": 1.0}, 0.0, 1e-9)] if voltage else []
    for name, (value, u) in options.known.items():
        if name == "loop_gain":  # of the sum of both: the resistance is some hundredths of it
            known.append(({"total": 1.0}, float(np.log(value)), float(np.hypot(u / value, RESISTANCE_SHARE))))
            continue
        known.append((_log_coefficients(name), float(np.log(value)), u / value))
    covariance = np.zeros((len(rows) + len(known),) * 2)
    covariance[: len(rows), : len(rows)] = fit.covariance[np.ix_(seen, seen)]
    for k, (row, value, relative) in enumerate(known, start=len(rows)):
        rows.append(row)
        values.append(value)
        covariance[k, k] = relative**2
    others = (*GAIN.values(), "loop_gain", "resistance_and_loop_gain")
    wanted = {name: _log_coefficients(name) for name in UNITS if name not in others}
    wanted[gain] = {gain: 1.0}
    if not voltage:
        wanted |= {"loop_gain": {"total": 1.0}, "resistance_and_loop_gain": {"total": 1.0}}
    if not rows:
        return tuple(Estimate(n, np.nan, np.nan, UNITS[n], NOT_SHOWN) for n in wanted)
    matrix = np.array([[row.get(name, 0.0) for name in unknown] for row in rows])
    half = np.linalg.cholesky(np.linalg.inv(covariance + 1e-18 * np.eye(len(rows)))).T
    solved = np.linalg.pinv(half @ matrix, rcond=1e-9)
    logs, spread = solved @ (half @ np.array(values)), solved @ solved.T
    _, size, axes = np.linalg.svd(half @ matrix)
    free = axes[np.sum(size > 1e-9 * size[0]) :]
    out = []
    for name in (n for n in UNITS if n in wanted):
        along = np.array([wanted[name].get(k, 0.0) for k in unknown])
        why = _explain_undetermined(name, fit, options) if np.linalg.norm(free @ along) > OPEN else ""
        value, relative = float(np.exp(along @ logs)), float(np.sqrt(along @ spread @ along))
        if name == "loop_gain" and not why:
            why, value, relative = _loop_gain(value, relative, logs, spread, unknown, free)
        out.append(
            _estimate(
                name,
                value,
                relative,
                UNITS[name],
                why or ("" if relative < 0.5 else "its uncertainty is as large as itself"),
            )
        )
    return tuple(out)


def _log_coefficients(name: str) -> dict[str, float]:
    """Coefficients of the fit's unknowns whose sum is the logarithm of the parameter ``name``."""
    return {"total": 1.0, "share": 1.0} if name == "resistance" else {name: 1.0}


def _loop_gain(
    total: float, relative: float, logs: Array, spread: Array, unknown: list[str], free: Array
) -> tuple[str, float, float]:
    """Gain of the current loop as (reason if undetermined, value, relative u): ``total``, its sum with the resistance,
    less the resistance's share; ``logs``, ``spread``: logarithms of ``unknown`` and covariance, ``free``: null space.
    """
    k = unknown.index("share")
    if np.linalg.norm(free[:, k]) > OPEN:
        return NOT_MET["share"], total, relative
    share = float(np.exp(logs[k]))
    slope = np.zeros(len(unknown))
    slope[unknown.index("total")], slope[k] = 1.0, -share / (1.0 - share)
    return "", total * (1.0 - share), float(np.sqrt(slope @ spread @ slope))


def _explain_undetermined(name: str, fit: LumpFit, options: DriveOptions) -> str:
    """Reason why a parameter is not determined: a limit that was not reached, or a value that must be stated."""
    for lump in NEEDED.get(name, ()):
        if not fit.determined[fit.names.index(lump)]:
            return NOT_MET[lump]
    if "torque_constant" in fit.names or options.known:
        if name == "resistance" and options.mode == "torque":
            return NOT_MET["share"]
        return "what is known beside the log does not fix it"
    return f"torques alone fix products of it; record the current, or give {GAIN[options.mode]} or torque_constant"
