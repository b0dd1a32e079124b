"""Parameter sets of an action: one TOML file each, found by built-in name or by path, read and written.

Every number has a unique path (``contact04.friction.A``) and carries unit, source and uncertainty. The built-in
``hirschkorn2004`` defines which paths exist and in which unit.
"""

from __future__ import annotations

import copy
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from model.elements.laws.felt_law import Law
from model.elements.laws.known import LAWS
from model.elements.laws.known import USUAL as USUAL
from model.errors import InputError, did_you_mean
from model.files.atomic_write import whole_file
from model.parameters.effects import effect_defaults
from model.parameters.quantity import Quantity, check_value, quantity_tables, read_quantity
from model.tabular import Tabular, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACTIONS = Path(__file__).parents[1] / "actions"
TEMPLATE = "hirschkorn2004"
SCENE = "scene"
"""Table of an action file that says what takes part (`model.scene.selection`)."""
SCENE_LISTS = ("bodies", "without", "effects")
IDENTIFICATION = "identification"
"""Table of an action file that says how its values were identified; it holds no value of the action."""
BODIES = ("key", "whippen", "jack", "repetition", "hammer")
CONTACTS = tuple(f"contact{i:02d}" for i in range(1, 14))

# contacts that have a meaning of their own in the code
CAPSTAN, KEY_FRONT, BACK_CHECK = "contact01", "contact02", "contact04"
JACK_KNUCKLE, BUTTON, JACK_LEVER = "contact07", "contact08", "contact09"
LEVER_KNUCKLE, DROP_SCREW, STRING = "contact10", "contact11", "contact12"

LAW = "law"  # last part of the path that names a contact's law of felt

UNIT_ERROR = 0.1  # of a unit vector's length: choice, above rounding of printed directions
MOST_CHANGED = 4  # shown by `repr`

_STRUCTURE_KEYS = {"parent", "body", "shape", "description", "name"}


def added_defaults() -> Mapping[str, Quantity]:
    """Quantities by path that an action's file need not hold: of effects, and of laws of felt for each contact."""
    return _added_defaults(tuple(LAWS.values()))


@cache
def _added_defaults(laws: tuple[Law, ...]) -> Mapping[str, Quantity]:
    of_laws = {
        f"{law.name}.{name}": Quantity(n.value, n.unit, n.u, "assumed", n.source)
        for law in laws
        for name, n in law.numbers.items()
    }
    return {**effect_defaults(), **{f"{c}.{path}": quantity for c in CONTACTS for path, quantity in of_laws.items()}}


def law_of(path: str) -> tuple[str, str] | None:
    """Contact and felt law of a parameter path; None where its second part names no law."""
    contact, law, *_ = *path.split("."), ""
    return (contact, law) if law in LAWS else None


def check_law(path: str, found: object, where: str) -> str:
    """The name of a law of felt; ``InputError`` for any other."""
    if not isinstance(found, str) or found not in LAWS:
        raise InputError(f"{where}: {path}: found {found!r}, allowed {', '.join(LAWS)}")
    return found


@dataclass(frozen=True, eq=False, repr=False)  # each is another: what is made of one is kept by it
class Action(Tabular):
    """An action's parameters; ``action["hammer.mass"]`` is a value, SI units.

    Attributes
    ----------
    name, description : names of the set
    quantities : path -> `Quantity`
    structure : path -> text that says which body, shape or law (``contact07.second.shape`` -> ``hybrid``)
    origin : file the set was read from
    changed : path -> value of each parameter set after reading
    effects : path -> `Quantity` of the effects a scene may add (`model.parameters.effects`) or felt with memory
    scene : what takes part wherever the action goes, names by list (``effects``, ``without``, ``bodies``); empty for
        the whole action without effects (`model.scene.selection`)
    identification : table of the file that says how its values were identified, as read; the model does not use it
    """

    name: str
    description: str
    quantities: Mapping[str, Quantity]
    structure: Mapping[str, str]
    origin: str
    changed: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Quantity] = field(default_factory=added_defaults)
    scene: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    identification: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        changed = [f"{path} = {value:g}" for path, value in self.changed.items()]
        more = f" and {len(changed) - MOST_CHANGED} more" if len(changed) > MOST_CHANGED else ""
        lines = [
            f"Action {self.name}: {self.description}",
            f"  {len(self.quantities)} parameters, from {self.origin}",
            *([f"  changed: {', '.join(changed[:MOST_CHANGED])}{more}"] if changed else []),
            *(f"  {key}: {', '.join(names)}" for key, names in self.scene.items()),
        ]
        return "\n".join(lines)

    def columns(self) -> dict[str, Any]:
        """One row for each parameter: its path, value, unit, standard uncertainty, basis and source."""
        known = {**self.quantities, **self.effects}
        rows = [(path, q.value, q.unit, q.u, q.basis, q.source) for path, q in known.items()]
        names = ("parameter", "value", "unit", "u", "basis", "source")
        return {name: [row[k] for row in rows] for k, name in enumerate(names)}

    def plot(self, *bodies: str, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the action from the side, mm, at the printed rest angles, into ``ax`` or a new figure."""
        from model.parameters.side_drawing import draw_side  # start-up: NumPy, only a plot needs it

        drawn = axes_or_new(ax)
        draw_side(drawn, self.quantities, self.structure)
        return drawn

    def save(self, path: str | Path) -> Path:
        """Write a ``.toml`` that `load_action` reads back, or the table as ``.csv``, ``.h5``, ``.parquet``."""
        if Path(path).suffix != ".toml":
            return super().save(path)
        write_action(self, path)
        return Path(path)

    def __getitem__(self, path: str) -> float:
        """Value of a parameter path, SI units."""
        found = self.quantities.get(path) or self.effects.get(path)
        if found is None:
            raise InputError(_unknown_path(path, {**self.quantities, **self.effects}))
        return found.value

    def with_values(self, overrides: Mapping[str, float], where: str = "`overrides`") -> Action:
        """Return a copy with other values by path, each in its quantity's unit and range, else `InputError`; 0 for a
        law, such as ``{"contact04.friction": 0}``, switches it off.

        ``where`` is the source of the values in messages.
        """
        quantities = {**self.quantities, **self.effects}
        changed = dict(self.changed)
        for path, value in overrides.items():
            for single in _expand(path, value, quantities):
                number = check_value(single, value, where)
                was = quantities[single]  # `replace` takes most of a draw's time
                quantities[single] = Quantity(number, was.unit, was.u, was.basis, f"set to {number:g} by the user")
                changed[single] = number
        effects = {path: quantities.pop(path) for path in self.effects}
        _check_shapes(quantities, where)
        return replace(self, quantities=quantities, changed=changed, effects=effects)

    def with_effects(self, values: Mapping[str, float]) -> Action:
        """Return a copy with a scene's values for its effects, path -> value; not counted as changed by the user."""
        effects = dict(self.effects)
        for path, value in values.items():
            number = check_value(path, value, "scene")
            effects[path] = replace(effects[path], value=number, source=f"set to {number:g} by the scene")
        return replace(self, effects=effects)

    def law(self, contact: str) -> str:
        """Law of felt that a contact follows, one of `model.elements.laws`."""
        return self.structure.get(f"{contact}.{LAW}", USUAL)

    def felt_has(self, path: str) -> bool:
        """Whether the contact's felt law uses the parameter of this path; True for paths of no felt law."""
        contact, _, last = path.partition(".")
        felt = law_of(path)
        return self.law(contact) == felt[1] if felt else last != "normal.D" or LAWS[self.law(contact)].damped

    def with_laws(self, laws: Mapping[str, str]) -> Action:
        """Copy whose contacts follow other laws of felt, contact -> name of the law; the numbers of these laws are as
        before or usual; `InputError` for an unknown contact or law."""
        structure = dict(self.structure)
        for contact, law in laws.items():
            if contact not in CONTACTS:
                raise InputError(f"felt law: found {contact!r}, allowed {CONTACTS[0]} to {CONTACTS[-1]}")
            structure[f"{contact}.{LAW}"] = check_law(f"{contact}.{LAW}", law, "felt law")
        effects = {**added_defaults(), **self.effects}  # a law may be younger than the action
        return replace(self, structure=structure, effects=effects)

    def content(self) -> str:
        """All values as text in a fixed order, for hashing; values of effects only where they differ from the
        default."""
        usual = added_defaults()
        own = {path: q for path, q in self.effects.items() if path not in usual or q.value != usual[path].value}
        lines = [f"{path}={q.value!r}" for path, q in sorted({**self.quantities, **own}.items())]
        laws = {contact: self.law(contact) for contact in CONTACTS}
        lines += (f"{c}.{LAW}={LAWS[law].stamp}" for c, law in laws.items() if law != USUAL)
        return "\n".join([*lines, *(f"{SCENE}.{key}={','.join(names)}" for key, names in sorted(self.scene.items()))])


_OFF_SWITCHES = {"friction": ("A",), "joint_friction": ("A",)}


def _expand(path: str, value: float, quantities: Mapping[str, Quantity]) -> list[str]:
    """Parameter paths that an override sets: its path, or, for the value 0 of a contact, spring, law or friction, those
    that switch it off; `InputError` for any other."""
    if path in quantities:
        return [path]
    last = path.split(".")[-1]
    if last.startswith("contact") and value == 0:
        keys = [f"{path}.normal.{k}" for k in ("a", "b", "c")]
    elif last.endswith("_spring") and value == 0:
        keys = [f"{path}.torque", f"{path}.stiffness"]
    else:
        keys = [f"{path}.{k}" for k in _OFF_SWITCHES.get(last, ())]
    if not keys or any(k not in quantities for k in keys):
        raise InputError(_unknown_path(path, quantities))
    if value != 0:
        raise InputError(f"`overrides` {path}: found {value:g}, allowed 0 (switches it off); or set {', '.join(keys)}")
    return keys


def _unknown_path(path: str, known: Mapping[str, Any]) -> str:
    files = f"model/actions/{TEMPLATE}.toml, model/parameters/effects.toml and model/elements/laws/"
    return f"parameter {path}: unknown path{did_you_mean(path, known)}all paths are in {files}"


@lru_cache(maxsize=8)
def _parse_toml(text: str) -> dict[str, Any]:
    """Table of a text, not to be changed: parsing takes three quarters of reading an action."""
    return tomllib.loads(text.removeprefix("\ufeff"))


def read_toml(path: Path) -> dict[str, Any]:
    """Parsed table of a TOML file, not to be changed; `InputError` where it cannot be read."""
    try:
        return _parse_toml(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(
            f"{path}: cannot be read ({problem.strerror}); name one that is built in or an existing file"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file in UTF-8; allowed a TOML file") from None
    except tomllib.TOMLDecodeError as problem:
        raise InputError(f"{path}: is not valid TOML: {problem}") from None


def _check_shapes(quantities: Mapping[str, Quantity], where: str) -> None:
    """Refuse normals that are not unit vectors and arcs that end before they start."""
    for key in quantities:
        if key.endswith(".normal.x"):
            length = math.hypot(quantities[key].value, quantities[key[:-1] + "y"].value)
            if not abs(length - 1.0) < UNIT_ERROR:
                allowed = f"allowed {1.0 - UNIT_ERROR:g} to {1.0 + UNIT_ERROR:g} (a unit vector)"
                raise InputError(f"{where}: {key[:-2]}: length found {length:g}, {allowed}")
    for key in quantities:
        if (
            key.endswith(".arc_start")
            and quantities[key].value >= quantities[key.replace("arc_start", "arc_end")].value
        ):
            raise InputError(f"{where}: {key}: found {quantities[key].value:g}, allowed below arc_end")


@cache
def _template() -> tuple[dict[str, str], dict[str, str]]:
    """Units by path and structure texts by path of the built-in set."""
    units: dict[str, str] = {}
    structure: dict[str, str] = {}
    for path, item in quantity_tables(read_toml(ACTIONS / f"{TEMPLATE}.toml")):
        if isinstance(item, dict):
            units[path] = item["unit"]
        elif path.split(".")[-1] not in ("description", "name"):
            structure[path] = item
    return units, structure


def find_action(name_or_path: str | Path) -> Path:
    """File of a built-in parameter set, or the path given where it ends in .toml (it need not exist) or exists; else
    `InputError`, which lists the built-in names."""
    text = str(name_or_path)
    built_in = ACTIONS / f"{text}.toml"
    if built_in.parent == ACTIONS and built_in.is_file():
        return built_in
    path = Path(text)
    if path.suffix == ".toml" or path.exists():
        return path
    names = sorted(p.stem for p in ACTIONS.glob("*.toml"))
    hint = did_you_mean(text, names)
    raise InputError(f"action {text!r}: not found{hint}built in: {', '.join(names)}; or name a .toml file")


def _scene_lists(table: Any, where: str) -> dict[str, tuple[str, ...]]:
    """Lists of names in the table ``scene`` of an action's file, by key, empty ones left out; `InputError` for another
    key or no list; the names are not checked here."""
    if not isinstance(table, dict):
        raise InputError(f"{where}: {SCENE}: found {table!r}, allowed a table with {', '.join(SCENE_LISTS)}")
    for key, names in table.items():
        if key not in SCENE_LISTS:
            raise InputError(f"{where}: {SCENE}.{key}: unknown key; allowed {', '.join(SCENE_LISTS)}")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(f"{where}: {SCENE}.{key}: found {names!r}, allowed a list of names")
    return {key: tuple(names) for key, names in table.items() if names}


def load_action(name_or_path: str | Path = TEMPLATE, overrides: Mapping[str, float] | None = None) -> Action:
    """Read and check a parameter set, built in (``hirschkorn2004``, ``hirschkorn2004-regulated``) or a TOML file, then
    set ``overrides``, path -> value in the quantity's unit.

    Parameters
    ----------
    name_or_path : ``hirschkorn2004`` (as printed in the thesis), ``hirschkorn2004-regulated``, or a TOML file
    overrides : path -> value, applied after reading

    Returns
    -------
    Action

    Raises
    ------
    InputError : a key is missing, unknown, out of range, in another unit; the message names it.

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004", {"contact04.friction.A": 0.3})
    >>> action["contact04.friction.A"], action.quantities["hammer.mass"].unit
    (0.3, 'kg')
    >>> path = action.save("mine.toml")
    """
    path = find_action(name_or_path)
    table = dict(read_toml(path))
    found = copy.deepcopy(table.pop(IDENTIFICATION, {}))  # how the values were found: for people and for validation
    scene = _scene_lists(table.pop(SCENE, {}), str(path))
    units, structure = _template()
    where = str(path)
    quantities: dict[str, Quantity] = {}
    effects = dict(added_defaults())
    found_structure: dict[str, str] = {}
    for key, item in quantity_tables(table):
        last = key.split(".")[-1]
        if key in units:
            quantities[key] = read_quantity(key, item, units[key], where)
        elif last in _STRUCTURE_KEYS and not isinstance(item, dict):
            if key in structure and item != structure[key]:
                raise InputError(f"{where}: {key}: found {item!r}, allowed {structure[key]!r}")
            found_structure[key] = item
        elif last == LAW and key.partition(".")[0] in CONTACTS and key.count(".") == 1:
            found_structure[key] = check_law(key, item, where)
        elif key in effects:
            effects[key] = read_quantity(key, item, effects[key].unit, where)
        else:
            raise InputError(f"{where}: {key}: unknown key; remove it or correct its name")
    for key in units.keys() - quantities.keys():
        raise InputError(
            f'{where}: {key}: missing; give a table with value, unit = "{units[key]}", u, basis and source'
        )
    for key in structure.keys() - found_structure.keys():
        raise InputError(f"{where}: {key}: missing; allowed {structure[key]!r}")
    _check_shapes(quantities, where)
    action = Action(
        name=str(table.get("name", path.stem)),
        description=str(table.get("description", "")),
        quantities=quantities,
        structure=found_structure,
        origin=where,
        effects=effects,
        scene=scene,
        identification=found if isinstance(found, dict) else {},
    )
    return action.with_values(overrides) if overrides else action


ActionLike = Action | str | Path
"""An action, the name of a built-in one, or a TOML file."""


def as_action(action: ActionLike) -> Action:
    """The parameter set itself, or that of a built-in name or a file."""
    if isinstance(action, Action):
        return action
    if isinstance(action, str | Path):
        return load_action(action)
    one = "one action: " if isinstance(action, list | tuple) else ""
    raise InputError(
        f"action: found {type(action).__name__}, allowed {one}a model.Action, a built-in name or a TOML file"
    )


def _text(value: str) -> str:
    plain = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in plain) + '"'


def action_text(action: Action, comment: Sequence[str] = ()) -> str:
    """The TOML text of an action; ``comment`` lines come first."""
    lines = [f"# {line}".rstrip() for line in comment]
    lines += ["", f"name = {_text(action.name)}", f"description = {_text(action.description)}"]
    tables: dict[str, list[str]] = {}
    for path, text in action.structure.items():
        table, _, rest = path.partition(".")
        if rest:
            tables.setdefault(table, []).append(f"{rest} = {_text(text)}")
    usual = added_defaults()
    own = {path: q for path, q in action.effects.items() if q != usual[path]}
    for path, q in (*action.quantities.items(), *own.items()):
        table, _, rest = path.partition(".")
        tables.setdefault(table, []).append(
            f"{rest} = {{ value = {float(q.value)!r}, unit = {_text(q.unit)}, u = {float(q.u)!r}, "
            f"basis = {_text(q.basis)}, source = {_text(q.source)} }}"
        )
    if action.scene:
        lists = (f"{key} = [{', '.join(map(_text, names))}]" for key, names in action.scene.items())
        tables[SCENE] = [*lists]
    for table, rows in tables.items():
        lines += ["", f"[{table}]", *rows]
    return "\n".join(lines) + "\n"


def write_action(action: ActionLike, path: str | Path, comment: Sequence[str] = ()) -> None:
    """Write an action to a TOML file ``path``, whole or not at all, in place of a file that is there; ``comment``:
    lines for its head.

    Parameters
    ----------
    action : parameter set
    path : file to write, ending in .toml
    comment : lines for its head

    Raises
    ------
    InputError : another ending, or the file cannot be written

    Examples
    --------
    >>> import model
    >>> heavier = model.load_action("hirschkorn2004", {"hammer.mass": 0.012})
    >>> model.write_action(heavier, "heavier.toml", ["a heavier hammer"])
    >>> model.load_action("heavier.toml")["hammer.mass"]
    0.012
    """
    action = as_action(action)
    target = Path(path)
    if target.suffix != ".toml":
        raise InputError(f"{target}: ending found {target.suffix!r}, allowed .toml")
    with whole_file(target) as part:
        part.write_text(action_text(action, comment), encoding="utf-8", newline="\n")
