"""Reading changes of parameters from the command line: ``--set``, ``--scale`` and whole variants.

A variant is one text, ``name: --set path=value --scale name=factor``, in double quotes in every shell; paths and
numbers hold no blanks, so blanks separate and nothing inside needs a quote.
"""

from __future__ import annotations

from collections.abc import Sequence

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


def read_variant(text: str) -> tuple[str, dict[str, float], dict[str, float]]:
    """Name, values to set and factors of ``name: --set path=value --scale name=factor``.

    Raises
    ------
    CommandInputError : no name, nothing to change, or something else than --set and --scale
    """
    name, colon, rest = (part.strip() for part in text.partition(":"))
    example = 'allowed "name: --set path=value --scale name=factor"'
    if not colon or not name:
        raise CommandInputError(f"--variant {text!r}: has no name; {example}")
    given: dict[str, list[str]] = {"--set": [], "--scale": []}
    words = iter(rest.split())
    for word in words:
        option, equals, value = word.partition("=")
        if option not in given:
            raise CommandInputError(f"--variant {name}: found {word!r}; {example}")
        given[option].append(value if equals else next(words, ""))
    if not any(given.values()):
        raise CommandInputError(f"--variant {name}: changes nothing; {example}")
    return name, read_settings(given["--set"]), read_settings(given["--scale"], "--scale")


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
