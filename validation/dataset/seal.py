"""Sealed truth: a salted SHA-256 published beside the data, and the check of a truth that is opened later.

The hash is over salt and text. Without the salt nobody can try likely truths against it; with both, published when the
truth is opened, anybody can see that it is the one that was sealed.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from validation.dataset.load import read_index
from validation.errors import ValidationInputError


def salted_sha256(text: str, salt: str) -> str:
    """SHA-256 over salt and text, hexadecimal."""
    return hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest()


def truth_text(truth: dict[str, Any]) -> str:
    """A truth as the text that is hashed: JSON with sorted keys."""
    return json.dumps(truth, indent=1, sort_keys=True) + "\n"


def check_truth(folder: str | Path, truth_file: str | Path, split: str = "sealed") -> dict[str, Any]:
    """Read a truth that was opened and check it against the hash the data set was published with.

    Parameters
    ----------
    folder : path
        The data set.
    truth_file : path
        The truth: JSON with ``salt`` and ``truth``.
    split : str
        Which it is the truth of.

    Returns
    -------
    dict
        The truth: specimens and faults by trial.

    Raises
    ------
    ValidationInputError
        It cannot be read, or is not the truth that was sealed.

    Examples
    --------
    >>> import validation
    >>> truth = validation.dataset.check_truth("dataset", "dataset/truth_open.json", "open")
    >>> [specimen["name"] for specimen in truth["specimens"]]
    ['A', 'B']
    """
    sealed = read_index(folder)["seal"].get(split)
    if sealed is None:
        raise ValidationInputError(f"{folder}: no hash of a truth of {split!r} was published with it")
    try:
        opened = json.loads(Path(truth_file).read_text(encoding="utf-8"))
        salt, truth = opened["salt"], opened["truth"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValidationInputError(f"{truth_file}: not a truth, JSON with salt and truth ({error})") from None
    found = salted_sha256(truth_text(truth), salt)
    if found != sealed:
        raise ValidationInputError(
            f"{truth_file}: its truth does not match the hash published with {folder}: found {found[:12]}…, published "
            f"{sealed[:12]}…; it was altered, or belongs to another data set"
        )
    return dict(truth)
