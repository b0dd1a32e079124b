"""What is known of a parameter before the strokes are looked at, and how it is moved.

Conventions: a parameter is moved in units of its prior standard uncertainty: z = 0 is the action's value, z = 1 one
u above; laws of friction, felt and springs by a factor, exp(u z), all else by u z in SI units.
The declared u is the prior, but for laws of friction, felt and springs whose u is only the rounding of printed digits:
that says nothing of the piece on the bench, and `LAW_U` takes its place (docs/explanation/identification.md).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import model
from model.parameters.quantity import Quantity, allowed_range
from validation.errors import ValidationInputError
from validation.infer.channels import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL, KEY_SCALE, KEY_ZERO
from validation.measurement.position_sensors import POSITION_ERRORS
from validation.prediction.input_sampling import LARGE_RELATIVE_U

FELT = "felt:"
STIFFNESS = ("a", "b", "c")
PARAMETERS = "`parameters`"
NORMAL = (".second.normal.x", ".second.normal.y")
BELONGS: Mapping[str, Callable[[str, Sequence[str]], bool]] = {
    "friction": lambda name, paths: name.endswith(".friction.A"),
    "joint_friction": lambda name, paths: name.endswith(".joint_friction.A"),
    "damping": lambda name, paths: name.endswith(".normal.D"),
    "stiffness": lambda name, paths: len(paths) > 1,
    "springs": lambda name, paths: (
        name.split(".")[0].endswith("_spring") and name.split(".")[-1] in ("torque", "stiffness")
    ),
}
"""Whether a single name with its paths belongs to a group."""
GROUPS = tuple(BELONGS)


def single_names(action: model.Action) -> dict[str, tuple[str, ...]]:
    """Name -> paths of each parameter that can be free: a felt's stiffness a, b, c together under the contact's name,
    every other path under its own; those with no value but 0 are left out."""
    values = {path: q.value for path, q in model.quantities_of(action).items()}
    names: dict[str, tuple[str, ...]] = {}
    for path in values:
        owner, _, last = path.rpartition(".")
        if owner.endswith(".normal") and last in STIFFNESS:
            name = owner.removesuffix(".normal")
            names[name] = (*names.get(name, ()), path)
        else:
            names[path] = (path,)
    return {name: paths for name, paths in names.items() if any(values[path] for path in paths)}


def lead_of(quantities: Mapping[str, Quantity], paths: Sequence[str]) -> Quantity:
    """The quantity whose u stands for paths that move together: the first that is not zero, as felt may have a = 0."""
    return next(quantities[path] for path in paths if quantities[path].value != 0.0)


def group_members(action: model.Action, group: str) -> list[str]:
    """Single names of a group; empty where it is none."""
    if group not in BELONGS:
        return []
    return [name for name, paths in single_names(action).items() if BELONGS[group](name, paths)]


def expand(action: model.Action, asked: Sequence[str], option: str = PARAMETERS) -> list[str]:
    """Single names of the parameters, groups (``friction``), felts (``felt:…``) and patterns ``asked`` for, in order,
    each once; input error for what is unknown, zero or fixed by the geometry. ``option``: how messages call the
    argument.

    A name is one of those of ``--set`` and ``--scale``, or ``felt:contact02``: stiffness and damping of that felt. A
    group stands for its members, each free by itself:

        friction            coefficient A of every contact that has one
        joint_friction      torque A of every joint
        damping             D of every contact
        stiffness           stiffness of every contact: a, b, c by one factor
        springs             torque or stiffness of the two springs

    Parameters
    ----------
    asked : names, groups or patterns
    option : for messages

    Raises
    ------
    ValidationInputError
        Nothing has that name, the value is zero, so that nothing says how large it might be, or it is to be identified
        and fixed by the geometry.
    """
    names = single_names(action)
    found: dict[str, None] = {}
    for text in (part.strip() for part in asked):
        members = group_members(action, text)
        if text.startswith(FELT):
            felt = text.removeprefix(FELT)
            members = [n for n in (felt, f"{felt}.normal.D") if n in names]
        elif text in names:
            members = [text]
        elif f"{text}.A" in names:  # a law by its name, as in `scale_parameters`
            members = [f"{text}.A"]
        elif not members:
            members = [n for n in names if fnmatchcase(n, text)] if "*" in text else []
            members = members or [n for n in names if n.rpartition(".")[0] == text and text.endswith("_spring")]
        if option == PARAMETERS:
            members = _keep_free(action, text, members)
        if not members:
            raise ValidationInputError(_unknown_message(action, text, option))
        found |= dict.fromkeys(members)
    if not found:
        raise ValidationInputError(f"{option}: none given; allowed names of `overrides`, or {', '.join(GROUPS)}")
    return list(found)


def _keep_free(action: model.Action, text: str, members: list[str]) -> list[str]:
    """Names of ``members`` without components of unit normals; refuses a ``text`` that the geometry fixes."""
    if text in action.structure:
        raise ValidationInputError(
            f"{PARAMETERS} {text}: is fixed by the geometry (it says {action.structure[text]!r}, which is no number); "
            "leave it out"
        )
    if text.endswith(NORMAL) and text in action.quantities:
        raise ValidationInputError(
            f"{PARAMETERS} {text}: is fixed by the geometry, as one component of a direction of length 1; leave it "
            "out, or identify a position of the same contact"
        )
    return [name for name in members if not name.endswith(NORMAL)]


def _unknown_message(action: model.Action, text: str, option: str) -> str:
    """Message that ``option`` names no parameter that can be fitted, with the nearest name."""
    for path in (text, f"{text}.A"):
        if path in model.quantities_of(action):
            return (
                f"{option} {path}: its value is {action[path]:g}, so nothing says how large it may be (no prior); "
                "set it to its order of magnitude with `overrides`, or leave it out"
            )
    known = [*GROUPS, *single_names(action)]
    near = difflib.get_close_matches(text.removeprefix(FELT), known, n=1)
    hint = f"; did you mean {near[0]}" if near else ""
    return f"{option} {text}: no such parameter, felt or group{hint}; groups: {', '.join(GROUPS)}"


LAW_U = 0.3
"""Relative standard uncertainty of a law's value whose stated u is only that of printed digits."""
INSIDE = 0.999  # share of the way to the end of what is allowed that a value goes
BOX = 4.0
"""A parameter is looked for within this many prior standard uncertainties."""
THRESHOLDS = ("friction_threshold.v_t", "friction_threshold.omega_t")
PRINTED = "printed digits"


@dataclass(frozen=True)
class Parameter:
    """One thing that may move.

    Attributes
    ----------
    name : as in `naming`
    paths : parameters of the action that move together
    u : prior standard uncertainty, relative (``factor``) or SI
    factor : whether it is moved by a factor
    basis : where u comes from
    """

    name: str
    paths: tuple[str, ...]
    u: float
    factor: bool
    basis: str

    def values(self, action: model.Action, z: float) -> dict[str, float]:
        """Values of its paths at ``z``."""
        if self.factor:
            return {path: action[path] * math.exp(self.u * z) for path in self.paths}
        return {path: action[path] + self.u * z for path in self.paths}

    def slope(self, action: model.Action, z: float) -> dict[str, float]:
        """Derivative of the value of each path with respect to z, SI."""
        if self.factor:
            return {path: self.u * value for path, value in self.values(action, z).items()}
        return dict.fromkeys(self.paths, self.u)

    def per_u(self, start: model.Action, z: float) -> float:
        """Change, per prior standard uncertainty, of the value that `model.sensitivities` differentiates by, at z."""
        if len(self.paths) > 1:  # a factor on the values that the action has now
            return self.u
        return self.slope(start, z)[self.paths[0]]

    def physical(self, action: model.Action, z: float) -> float:
        """Value at ``z``: the factor where several paths move together, SI of the only path otherwise."""
        if not self.paths:
            return z
        if len(self.paths) > 1:
            return math.exp(self.u * z)
        return self.values(action, z)[self.paths[0]]

    def unit(self, action: model.Action) -> str:
        """Unit of `physical`; ``1`` for a factor."""
        return "1" if len(self.paths) != 1 else {**action.quantities, **action.effects}[self.paths[0]].unit

    def box(self, action: model.Action) -> tuple[float, float]:
        """Lowest and highest z that a fit allows: `BOX` prior standard uncertainties to either side, or less where the
        allowed range of the value ends before."""
        low, high = -BOX, BOX
        if not self.factor and self.paths:
            least, most, _ = allowed_range(self.paths[0])
            low = max(low, INSIDE * (least - action[self.paths[0]]) / self.u)
            high = min(high, INSIDE * (most - action[self.paths[0]]) / self.u)
        return low, high


FORCE = tuple(
    Parameter(name, (), 1.0, False, "force channel of each trial") for name in (FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY)
)
"""Errors of the force that all trials share, in standard uncertainties; no path of the action."""
KEY = tuple(Parameter(name, (), 1.0, False, "key encoder of each trial") for name in (KEY_SCALE, KEY_ZERO))
"""The same of the key's encoder, where it drives the model in some trials."""
POSITIONS = tuple(
    Parameter(error.name, (), 1.0, False, f"position sensor of each trial: {error.meaning}")
    for error in POSITION_ERRORS
)
"""The same of position sensors."""


@dataclass(frozen=True)
class Unknowns:
    """All that may move: what was asked for, and what is uncertain beside it."""

    asked: tuple[Parameter, ...]  # parameters to identify
    beside: tuple[Parameter, ...]  # laws that were not asked for and not fixed; fitted, not reported as identified
    small: tuple[Parameter, ...]  # all other parameters with u > 0: masses, geometry; fitted likewise
    # laws that are fixed; they scatter from trial to trial, and tell how large a response is
    held: tuple[Parameter, ...] = ()
    # errors of what drives the model, fitted with the rest: two of their u already bend a stroke
    force: tuple[Parameter, ...] = FORCE

    @property
    def moved(self) -> tuple[Parameter, ...]:
        """Those that the fit moves: all of them."""
        return (*self.asked, *self.beside, *self.small, *self.force)


def parameter_of(
    action: model.Action, name: str, paths: tuple[str, ...], given: float | None = None
) -> Parameter | None:
    """Parameter of a single name with its ``paths`` and prior u: ``given`` (relative for laws, else SI), or as stated
    by the action; None where its stated u is 0."""
    lead = lead_of(model.quantities_of(action), paths)
    value = abs(lead.value)
    law = any(belongs(name, paths) for belongs in BELONGS.values())
    if given is not None:
        factor = law or name in THRESHOLDS
        return Parameter(name, paths, given, factor, "given")
    if lead.u <= 0.0:
        return None
    if law and lead.basis == PRINTED:
        return Parameter(name, paths, LAW_U, True, f"{LAW_U:.0%} taken: stated u is that of printed digits")
    if (law or lead.u > LARGE_RELATIVE_U * value) and value > 0.0:
        return Parameter(name, paths, math.sqrt(math.log1p((lead.u / value) ** 2)), True, lead.basis)
    return Parameter(name, paths, lead.u, False, lead.basis)


def unknowns(
    action: model.Action, asked: Sequence[str], fixed: Sequence[str] = (), priors: Mapping[str, float] | None = None
) -> Unknowns:
    """Parameters of an action by what a fit does with them: asked, fitted beside those, small, fixed; raises an input
    error for an unknown name or one without a prior.

    Parameters
    ----------
    asked, fixed : names, see `naming`
    priors : name -> standard uncertainty, relative for laws, SI otherwise

    Raises
    ------
    ValidationInputError
        A name is unknown, asked for and fixed, or has no prior; a prior is not above zero.
    """
    wanted = expand(action, asked)
    held = expand(action, fixed, "`fixed`") if fixed else []
    given = _parse_priors(action, priors or {})
    for name in fixed:  # a group or pattern means the rest of it
        if name.strip() in wanted:
            raise ValidationInputError(f"`fixed` {name}: found it in `parameters`, too; allowed in one of the two")
    held = [name for name in held if name not in wanted]
    names, found = single_names(action), []
    for name in wanted:
        one = parameter_of(action, name, names[name], given.get(name))
        if one is None:
            raise ValidationInputError(
                f"`parameters` {name}: its stated uncertainty is 0, so it has no prior; give one, `priors` {name}=0.1"
            )
        found.append(one)
    rest = [n for n in names if n not in wanted and n not in held]
    others = [p for p in (parameter_of(action, n, names[n], given.get(n)) for n in rest) if p is not None]
    still = [p for p in (parameter_of(action, n, names[n]) for n in held) if p is not None and p.factor]
    beside, small = [p for p in others if p.factor], [p for p in others if not p.factor]
    return Unknowns(tuple(found), tuple(beside), tuple(small), tuple(still))


def _parse_priors(action: model.Action, priors: Mapping[str, float]) -> dict[str, float]:
    out: dict[str, float] = {}
    for text, u in priors.items():
        if not (math.isfinite(u) and u > 0.0):
            raise ValidationInputError(f"`priors` {text}: standard uncertainty found {u:g}, allowed above 0")
        out |= dict.fromkeys(expand(action, [text], "`priors`"), float(u))
    return out
