"""Reading changes of an action from the command line: ``--scene``, ``--set``, ``--scale`` and whole variants."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import model
from model.parameters.action import LAW
from pianorig.errors import CommandInputError

_EXAMPLES = {
    "--set": "path=value, for example contact04.friction.A=0.3",
    "--scale": "name=factor, for example damping=0.1",
    "--target-mm": "name=mm, for example let_off=1.5",
}


def read_settings(settings: Sequence[str], option: str = "--set") -> dict[str, float]:
    """Numbers by path from texts ``path=value``; CommandInputError, which names ``option``, for another form, no
    number, or a path given twice."""
    out: dict[str, float] = {}
    for setting in settings:
        path, equals, text = (part.strip() for part in setting.partition("="))
        if not equals or not path:
            raise CommandInputError(f"{option} {setting!r}: allowed {_EXAMPLES[option]}")
        if path in out:
            raise CommandInputError(f"{option} {path}: given twice; allowed once")
        try:
            out[path] = float(text)
        except ValueError:
            raise CommandInputError(f"{option} {path}: value found {text!r}, allowed a number") from None
    return out


def split_laws(settings: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Split ``--set`` texts into felt laws, law by contact from ``contact12.law=stulov``, and all others, unparsed, in
    their order; CommandInputError for a contact given twice."""
    laws: dict[str, str] = {}
    others = []
    for setting in settings:
        path, equals, law = (part.strip() for part in setting.partition("="))
        contact, dot, last = path.rpartition(".")
        if not (equals and dot and last == LAW):
            others.append(setting)
            continue
        if contact in laws:
            raise CommandInputError(f"--set {path}: given twice; allowed once")
        laws[contact] = law
    return laws, others


def load_changed(
    action: str, set_: Sequence[str] | None, scale: Sequence[str] | None = None, scene: str | None = None
) -> model.Action:
    """The action in a scene, by default its own, with what ``--set`` gives, then with what ``--scale`` multiplies."""
    laws, others = split_laws(set_ or [])
    return _change_action(action, laws, read_settings(others), read_settings(scale or [], "--scale"), scene)


def _change_action(
    action: str, laws: dict[str, str], values: dict[str, float], factors: dict[str, float], scene: str | None
) -> model.Action:
    """Load an action, apply scene, felt laws by contact, values and factors by path, in this order, so that values go
    before the scene's; an error for a value whose effect or law the action lacks."""
    loaded = model.load_action(action)
    if scene is not None:
        loaded = model.load_scene(scene).apply_to(loaded)
    changed = loaded.with_laws(laws).with_values(values)
    model.choice_of(changed).check(changed)
    say_idle(changed, [*values, *factors])
    return model.scale_parameters(changed, factors)


def say_idle(action: model.Action, names: Iterable[str]) -> None:
    """Warn of each D among names whose felt follows a law without one: it stays in the action and changes nothing."""
    for path in names:
        if not action.felt_has(path):
            law = action.law(path.partition(".")[0])
            warnings.warn(f"{path}: changes nothing, the law of this felt ({law}) has no D", stacklevel=2)


def name_with_scene(action: model.Action, scene: str | None) -> model.Action:
    """The action with the scene that was chosen for it in its name, as reports and sheets call it."""
    return action if scene is None else replace(action, name=f"{action.name} (scene {Path(scene).stem})")


def read_variant(text: str, called: str = "--variant") -> tuple[str, dict[str, float], dict[str, float]]:
    """Parse ``name: --set path=value --scale name=factor``: the name, values by path, factors by name;
    CommandInputError, which begins with ``called``, for another form, a scene or a law."""
    name, colon, rest = (part.strip() for part in text.partition(":"))
    example = 'allowed "name: --set path=value --scale name=factor"'
    if not colon or not name:
        raise CommandInputError(f"{called} {text!r}: has no name; {example}")
    given = _options_of(name, rest, called, example)
    if given["--scene"]:
        raise CommandInputError(f"{called} {name}: found --scene, allowed --set and --scale; {example}")
    laws, others = split_laws(given["--set"])
    if laws:
        raise CommandInputError(
            f"{called} {name}: found a law of felt ({', '.join(laws)}), allowed numbers; "
            "laws are compared by simulate --set CONTACT.law=NAME, or by validate with one --action for each"
        )
    return name, read_settings(others), read_settings(given["--scale"], "--scale")


def _options_of(name: str, rest: str, called: str, example: str) -> dict[str, list[str]]:
    """Values of ``--scene``, ``--set`` and ``--scale`` in the text ``rest`` after a variant's ``name``, as written, by
    option; CommandInputError, with ``called`` and ``example``, for another option or none."""
    given: dict[str, list[str]] = {"--scene": [], "--set": [], "--scale": []}
    words = iter(rest.split())
    for word in words:
        option, equals, value = word.partition("=")
        if option not in given:
            raise CommandInputError(f"{called} {name}: found {word!r}; {example}")
        given[option].append(value if equals else next(words, ""))
    if not any(given.values()):
        raise CommandInputError(f"{called} {name}: changes nothing; {example}")
    return given


def load_model(text: str, settings: Sequence[str] = (), scene: str | None = None) -> model.Action:
    """Load the action that ``--action`` names: ``action`` or ``action: --scene name --set path=value --scale
    name=factor``; what differs from the action as given is added to its name.

    Parameters
    ----------
    text : is set as ``contact12.law=stulov``
    settings : ``--set`` beside it, for every model; those of the text go before them
    scene : ``--scene`` beside it, likewise
    """
    name, rest = split_model(text)
    laws, others = split_laws(settings)
    changes = read_settings(others)
    example = 'allowed "action: --scene name --set path=value --scale name=factor"'
    given = _options_of(name, rest, "--action", example) if rest else dict.fromkeys(("--scene", "--set", "--scale"), [])
    own, numbers = split_laws(given["--set"])
    values, factors = read_settings(numbers), read_settings(given["--scale"], "--scale")
    if len(given["--scene"]) > 1:
        raise CommandInputError(f"--action {name}: --scene found {len(given['--scene'])} times, allowed once")
    scene = given["--scene"][0] if given["--scene"] else scene
    laws |= own
    action = _change_action(name, laws, {**changes, **values}, factors, scene)
    said = [] if scene is None else [f"scene {Path(scene).stem}"]
    said += [f"{contact}.{LAW}={law}" for contact, law in laws.items()]  # a report names no law anywhere else
    said += [f"{path}={value:g}" for path, value in values.items()]
    said += [f"{path} × {factor:g}" for path, factor in factors.items()]
    return replace(action, name=f"{action.name} ({', '.join(said)})") if said else action


def split_model(text: str) -> tuple[str, str]:
    """The action and the options of ``action: --set …``; no options where there are none."""
    name, colon, rest = text.partition(": --")
    return (name.strip(), f"--{rest}") if colon else (text, "")


def read_measured(text: str, option: str) -> tuple[float, float | None]:
    """Parse ``0.35+-0.01`` to value and standard uncertainty, ``0.35`` to value and None; CommandInputError, which
    begins with ``option``, for another form or a negative uncertainty."""
    value, sign, u = (part.strip() for part in text.partition("+-"))
    try:
        found = float(value), float(u) if sign else None
    except ValueError:
        raise CommandInputError(
            f"{option} {text!r}: allowed a number, or value+-standard uncertainty as in 0.35+-0.01"
        ) from None
    if found[1] is not None and not found[1] >= 0.0:
        raise CommandInputError(f"{option} {text!r}: uncertainty found {u}, allowed from 0")
    return found
