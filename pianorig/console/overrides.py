"""Reading changes of parameters from the command line: ``--set``, ``--scale`` and whole variants.

A variant is one text, ``name: --set path=value --scale name=factor``, in double quotes in every shell; paths and
numbers hold no blanks, so blanks separate and nothing inside needs a quote.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import model
from pianorig.errors import CommandInputError

_EXAMPLES = {
    "--set": "path=value, for example contact04.friction.A=0.3",
    "--scale": "name=factor, for example damping=0.1",
    "--target-mm": "name=mm, for example let_off=1.5",
}


def read_settings(settings: Sequence[str], option: str = "--set") -> dict[str, float]:
    """Turn ``["contact04.friction=0"]`` into ``{"contact04.friction": 0.0}``.

    Raises
    ------
    CommandInputError : no equals sign, the value is not a number, or one name is given twice
    """
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


def load_changed(action: str, set_: Sequence[str] | None, scale: Sequence[str] | None) -> model.Action:
    """The action with what ``--set`` gives, then with what ``--scale`` multiplies."""
    values, factors = read_settings(set_ or []), read_settings(scale or [], "--scale")
    return model.scaled(model.load_action(action, values), factors)


def read_variant(text: str, called: str = "--variant") -> tuple[str, dict[str, float], dict[str, float]]:
    """Name, values to set and factors of ``name: --set path=value --scale name=factor``.

    Raises
    ------
    CommandInputError : no name, nothing to change, or something else than --set and --scale
    """
    name, colon, rest = (part.strip() for part in text.partition(":"))
    example = 'allowed "name: --set path=value --scale name=factor"'
    if not colon or not name:
        raise CommandInputError(f"{called} {text!r}: has no name; {example}")
    given: dict[str, list[str]] = {"--set": [], "--scale": []}
    words = iter(rest.split())
    for word in words:
        option, equals, value = word.partition("=")
        if option not in given:
            raise CommandInputError(f"{called} {name}: found {word!r}; {example}")
        given[option].append(value if equals else next(words, ""))
    if not any(given.values()):
        raise CommandInputError(f"{called} {name}: changes nothing; {example}")
    return name, read_settings(given["--set"]), read_settings(given["--scale"], "--scale")


def load_model(text: str, changes: Mapping[str, float]) -> model.Action:
    """The model of ``validate --action``: an action, or ``action: --set path=value --scale name=factor``.

    Parameters
    ----------
    text : str
        A colon counts only where a blank and an option follow it, so that ``C:\\mine.toml`` is a path.
    changes : mapping
        Values of ``--set`` beside it, for every model; those of the text go before them.

    Raises
    ------
    CommandInputError : something else than --set and --scale follows the colon, or a value given twice
    """
    name, rest = split_model(text)
    if not rest:
        return model.load_action(text, changes)
    _, values, factors = read_variant(f"{name}: {rest}", "--action")
    action = model.scaled(model.load_action(name, {**changes, **values}), factors)
    said = [f"{path}={value:g}" for path, value in values.items()]
    said += [f"{path} × {factor:g}" for path, factor in factors.items()]
    return replace(action, name=f"{action.name} ({', '.join(said)})")


def split_model(text: str) -> tuple[str, str]:
    """The action and the options of ``action: --set …``; no options where there are none."""
    name, colon, rest = text.partition(": --")
    return (name.strip(), f"--{rest}") if colon else (text, "")


def read_measured(text: str, option: str) -> tuple[float, float | None]:
    """Turn ``0.35+-0.01`` into value and standard uncertainty, ``0.35`` into value and None.

    Raises
    ------
    CommandInputError : not a number, or an uncertainty below zero
    """
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
