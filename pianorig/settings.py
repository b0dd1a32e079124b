"""Reading ``path=value`` settings of the command line."""

from __future__ import annotations

from collections.abc import Sequence

from .errors import InputError


def read_settings(settings: Sequence[str]) -> dict[str, float]:
    """Turn ``["contact04.friction=0"]`` into ``{"contact04.friction": 0.0}``.

    Raises
    ------
    InputError : no equals sign, or the value is not a number
    """
    out: dict[str, float] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not path.strip():
            raise InputError(f"--set {setting!r}: allowed path=value, for example contact04.friction.A=0.3")
        try:
            out[path.strip()] = float(text)
        except ValueError:
            raise InputError(f"--set {path.strip()}: value found {text!r}, allowed a number") from None
    return out
