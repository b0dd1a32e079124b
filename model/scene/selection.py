"""Selection of a scene's elements and outputs: built-in names and small TOML files, for ``simulate(scene=...)``.

    bodies = ["key", "whippen"]            # default: all; a body brings its contacts with the bodies present
    without = ["contact12", "jack_spring"] # contacts and springs to leave out
    outputs = ["contact_forces", "energy"] # beyond angles and speeds
    effects = ["balance_rail"]             # beyond the action itself (model.parameters.effects)

    [contact02]                            # the law of a contact's felt (model.elements.laws), and its values
    law = "<law>"
    <law>.<number> = 0.3

    [shank]                                # a table switches its effect on, and gives values other than the action's
    frequency_hz = 80.0

What is left out is not in the compiled kernels. A new structure compiles once (seconds) and is cached on disk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from model.errors import InputError, did_you_mean
from model.parameters.action import (
    BODIES,
    CONTACTS,
    LAW,
    SCENE_LISTS,
    STRING,
    Action,
    ActionLike,
    added_defaults,
    as_action,
    check_law,
    law_of,
    read_toml,
)
from model.parameters.effects import ARM, EFFECTS, FINGER, MOTOR, PINS, RAIL, effect_of
from model.parameters.quantity import Quantity, check_value, quantity_tables

SPRINGS = ("jack_spring", "repetition_spring")
OUTPUTS = ("contact_forces", "energy", "inside")
LISTS = ("bodies", "without", "outputs", "effects")


@dataclass(frozen=True)
class SceneChoice:
    """Bodies that take part, contacts and springs left out, requested outputs, effects, felt laws, their values."""

    bodies: tuple[str, ...] = BODIES
    without: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    values: tuple[tuple[str, float], ...] = ()
    laws: tuple[tuple[str, str], ...] = ()  # contact and law of its felt

    def __post_init__(self) -> None:
        """Refuse names that do not exist and children without their parent."""
        for name, found, allowed in (
            ("bodies", self.bodies, BODIES),
            ("without", self.without, (*CONTACTS, *SPRINGS)),
            ("outputs", self.outputs, OUTPUTS),
            ("effects", self.effects, EFFECTS),
        ):
            for item in found:
                if item not in allowed:
                    raise InputError(f"scene: {name}: found {item!r}, allowed {', '.join(allowed)}")
        # in which order a file names them says nothing; columns are read by that of `BODIES`
        object.__setattr__(self, "bodies", tuple(body for body in BODIES if body in self.bodies))
        for child in ("jack", "repetition"):
            if child in self.bodies and "whippen" not in self.bodies:
                raise InputError(f"scene: bodies: {child} hangs from the whippen; add whippen or leave out {child}")
        bodies, effects = self.bodies, self.effects
        for wrong, words in (
            ("key" not in bodies, "bodies: found no key, allowed scenes with the key, on which the force acts"),
            (
                "shank" in effects and "hammer" not in bodies,
                "effects: shank needs the hammer; add hammer or leave out shank",
            ),
            (
                "motor_drive" in effects and "motor_arm" not in effects,
                "effects: motor_drive turns the motor_arm; add motor_arm or leave out motor_drive",
            ),
            (
                {"finger", "motor_arm"} <= set(effects),
                "effects: found finger and motor_arm, allowed one of them on the key",
            ),
            (
                "string" in effects and ("hammer" not in bodies or STRING in self.without),
                f"effects: string needs the hammer and {STRING}; add them or leave out string",
            ),
        ):
            if wrong:
                raise InputError(f"scene: {words}")

    @property
    def input_column(self) -> str:
        """Column of the input table: name and unit."""
        columns = {"motor_drive": "command_v", "finger": "finger_m", "motor_arm": "torque_nm"}
        return next((column for effect, column in columns.items() if effect in self.effects), "force_n")

    @property
    def prescribed_coordinate(self) -> str:
        """The coordinate that a prescribed motion moves: motor arm or finger where one presses, else the key."""
        return MOTOR if ARM in self.effects else FINGER if FINGER in self.effects else "key"

    def apply_to(self, action: Action) -> Action:
        """Copy of the action with this scene, its laws of felt and values; values that the user has set by path in the
        action take precedence."""
        chosen = action.with_laws(dict(self.laws)) if self.laws else action
        values = {path: value for path, value in self.values if path not in action.changed}
        chosen = chosen.with_effects(values) if values else chosen
        bodies = () if self.bodies == BODIES else self.bodies
        lists = zip(SCENE_LISTS, (bodies, self.without, self.effects), strict=True)
        scene = {key: names for key, names in lists if names}
        return chosen if chosen.scene == scene else replace(chosen, scene=scene)

    moved, on = prescribed_coordinate, apply_to  # former names, for one release

    def need_played_key(self, name: str) -> None:
        """Refuse a choice that lacks a body or that no force on the key drives, for what needs both."""
        if self.input_column != "force_n" or set(BODIES) - set(self.bodies):
            raise InputError(
                f"{name}: found a scene of {', '.join(self.bodies)} driven by {self.input_column}, "
                "allowed one with all bodies driven by force_n; choose another (`scene`)"
            )

    def check(self, action: Action) -> None:
        """Refuse a value of an effect, or of a law of felt, that the scene does not have: it would change nothing."""
        for path in action.changed:
            effect = effect_of(path)
            if effect is not None and effect not in self.effects:
                raise InputError(
                    f"{path} is set but the scene has no {effect}; choose a scene with it (effects = [{effect!r}])"
                )
            felt = law_of(path)  # D and the slow curve stay in an action whose felt follows another law for a while
            if felt is not None and action.law(felt[0]) != felt[1]:
                raise InputError(
                    f"{path} is set but {felt[0]} follows the law {action.law(felt[0])}; "
                    f"choose the other ({felt[0]}.law = \"{felt[1]}\" in the action's or the scene's file)"
                )


SCENES = {
    "whole": SceneChoice(),
    "without-string": SceneChoice(without=("contact12",)),
    "key": SceneChoice(bodies=("key",)),
    "key-whippen": SceneChoice(bodies=("key", "whippen")),
    "lifting-key": SceneChoice(effects=("balance_rail",)),
    "flexible-shank": SceneChoice(effects=("shank",)),
    "motor-arm": SceneChoice(effects=("motor_arm",)),
    "motor-drive": SceneChoice(effects=("motor_arm", "motor_drive")),
    "motor-voltage": SceneChoice(
        effects=("motor_arm", "motor_drive"),
        values=(
            ("motor_drive.current_gain", 0.0),
            ("motor_drive.loop_gain", 0.0),
            ("motor_drive.voltage_gain", 2.0),
        ),
    ),
    "compliant-tip": SceneChoice(effects=("motor_arm",), values=(("motor_arm.contact_c", 4.0e3),)),  # choice, N/m
    "finger": SceneChoice(effects=("finger",)),
    "string": SceneChoice(effects=("string",)),
    "lifting-key-flexible-shank": SceneChoice(effects=("balance_rail", "shank")),
    "giving-hammer": SceneChoice(effects=("hammer_pin",)),
    "giving-joints": SceneChoice(effects=("balance_rail", *PINS)),
}


def choice_of(action: ActionLike, scene: str | Path | SceneChoice | None = None) -> SceneChoice:
    """What takes part in a scene given by name, file or choice; by default (None) what the action's own scene says.

    Parameters
    ----------
    action : parameter set
    scene : as for `load_scene`, or None

    Returns
    -------
    SceneChoice

    Raises
    ------
    InputError : there is no such scene, or the action's file names what does not exist

    Examples
    --------
    >>> import model
    >>> strung = model.load_scene("string").apply_to(model.load_action())
    >>> model.choice_of(strung).effects, model.choice_of(strung, "whole").effects
    (('string',), ())
    """
    action = as_action(action)
    if scene is not None:
        return load_scene(scene)
    try:
        bodies, without, effects = (tuple(action.scene.get(key, ())) for key in SCENE_LISTS)
        return SceneChoice(bodies or BODIES, without, effects=effects)
    except InputError as problem:
        raise InputError(f"{action.origin}: {problem}") from None


def quantities_of(action: ActionLike) -> dict[str, Quantity]:
    """Quantities by path that play a part in the action's scene: its own, then those of its effects and felt laws.

    Parameters
    ----------
    action : parameter set

    Returns
    -------
    dict

    Examples
    --------
    >>> import model
    >>> strung = model.load_scene("string").apply_to(model.load_action())
    >>> sorted(model.quantities_of(strung).keys() - strung.quantities.keys())[:3]
    ['string.b1', 'string.b2', 'string.length']
    """
    action = as_action(action)
    found, effects = {**action.quantities, **action.effects}, (None, *choice_of(action).effects)
    return {path: q for path, q in found.items() if effect_of(path) in effects and action.felt_has(path)}


def load_scene(name_or_path: str | Path | SceneChoice) -> SceneChoice:
    """A choice of what takes part, by built-in name or from a TOML file.

    Parameters
    ----------
    name_or_path : one of `model.SCENES`, a TOML file, or a choice, which is returned as it is

    Returns
    -------
    SceneChoice

    Raises
    ------
    InputError : there is no such scene, or the file cannot be used; the message says which key

    Examples
    --------
    >>> import model
    >>> model.load_scene("lifting-key").effects
    ('balance_rail',)
    """
    if isinstance(name_or_path, SceneChoice):
        return name_or_path
    if str(name_or_path) in SCENES:
        return SCENES[str(name_or_path)]
    path = Path(name_or_path)
    if path.suffix != ".toml":
        hint = did_you_mean(str(path), SCENES)
        raise InputError(f"scene {str(path)!r}: not found{hint}built in: {', '.join(SCENES)}; or name a .toml file")
    return scene_of(read_toml(path), str(path))


def scene_of(table: Mapping[str, Any], where: str) -> SceneChoice:
    """A choice of what takes part from the parsed tables of a file.

    Parameters
    ----------
    table : the file's tables
    where : name of the file, for errors

    Returns
    -------
    SceneChoice

    Raises
    ------
    InputError : a key or value that is not allowed

    Examples
    --------
    >>> import model
    >>> model.scene_of({"bodies": ["key", "whippen"]}, "mine.toml").bodies
    ('key', 'whippen')
    """
    chosen: dict[str, tuple[str, ...]] = {}
    values: list[tuple[str, float]] = []
    on: list[str] = []
    laws: list[tuple[str, str]] = []
    for key, value in table.items():
        if key in CONTACTS and isinstance(value, dict):
            law = check_law(f"{key}.{LAW}", value.get(LAW), where)
            laws.append((key, law))
            values += _felt(where, key, law, {name: item for name, item in value.items() if name != LAW})
            continue
        if key in EFFECTS and isinstance(value, dict):
            on.append(key)
            values += _effect_values(where, key, value)
            continue
        if key not in LISTS:
            raise InputError(
                f"{where}: {key}: unknown key; allowed {', '.join((*LISTS, *EFFECTS))}, contact01 and so on"
            )
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise InputError(f"{where}: {key}: found {value!r}, allowed a list of names")
        chosen[key] = tuple(value)
    if "bodies" in chosen:
        chosen["bodies"] = tuple(b for b in BODIES if b in chosen["bodies"]) + tuple(
            b for b in chosen["bodies"] if b not in BODIES
        )
    named = chosen.pop("effects", ())
    effects = (*named, *(e for e in on if e not in named))
    return SceneChoice(**chosen, effects=effects, values=tuple(values), laws=tuple(laws))


def _effect_values(where: str, effect: str, table: dict[str, Any]) -> list[tuple[str, float]]:
    """Paths and checked values of an effect's or a contact's table in a scene file."""
    known, out = added_defaults(), []
    for key, item in quantity_tables(table, f"{effect}."):
        if key not in known:
            allowed = ", ".join(p for p in known if p.startswith(f"{effect}."))
            raise InputError(f"{where}: {key}: unknown key; allowed {allowed}")
        out.append((key, check_value(key, item, where)))
    return out


def _felt(where: str, contact: str, law: str, table: dict[str, Any]) -> list[tuple[str, float]]:
    """Values of a contact's table, which must be those of its law."""
    values = _effect_values(where, contact, table)
    for path, _ in values:
        if law_of(path) != (contact, law):
            raise InputError(f"{where}: {path}: found beside the law {law}, allowed {contact}.{law}. and its numbers")
    return values


def check_prescribed(choice: SceneChoice) -> None:
    """Refuse a choice in which nothing is left to solve for when a motion is prescribed."""
    if len(choice.bodies) == 1 and choice.prescribed_coordinate == "key" and RAIL not in choice.effects:
        raise InputError("scene: found nothing but the prescribed key, allowed scenes with another body")
