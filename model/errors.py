"""Errors of the model: a small hierarchy whose messages are one line a user can act on."""

import difflib
import math
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")


class ModelError(Exception):
    """Base of everything the model raises on purpose."""

    exit_code = 1


class ModelInputError(ModelError, ValueError):
    """A parameter file, a table or an argument is wrong; the message names it, the value found and those allowed."""

    exit_code = 2


InputError = ModelInputError


class RegulationError(ModelInputError):
    """The action cannot be regulated with the travel its screws have.

    Attributes
    ----------
    target : name of the target that stays off, "" where no single one does
    off_m : by how much, NaN where it cannot be measured
    """

    def __init__(self, message: str, target: str = "", off_m: float = math.nan) -> None:
        super().__init__(message)
        self.target = target
        self.off_m = off_m


class IntegrationError(ModelError):
    """The integration could not go on; the message says when, why, and what to try."""


class StaticsError(ModelError):
    """No static equilibrium was found near the starting point."""


def did_you_mean(word: str, known: Iterable[str], most: int = 1) -> str:
    """Text to join a message on an unknown name: the nearest of the ``known`` names, or those that contain it.

    Parameters
    ----------
    word : what was found
    known : the names there are
    most : names to offer

    Returns
    -------
    str : begins with a semicolon, ends with a space

    Examples
    --------
    >>> from model.errors import did_you_mean
    >>> "unknown" + did_you_mean("hamer", ["hammer", "key"]) + "allowed hammer, key"
    'unknown; did you mean hammer? allowed hammer, key'
    """
    names = list(known)
    near = difflib.get_close_matches(word, names, n=most) or [name for name in names if word and word in name][:most]
    return f"; did you mean {' or '.join(near)}? " if near else "; "
