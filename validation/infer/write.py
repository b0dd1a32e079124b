"""Writing an identification: the action file and its page, both or neither."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from validation.infer.action_file import identified_text
from validation.infer.further import Prospect
from validation.infer.report import render_identification
from validation.infer.result import Identification
from validation.report.files import check_target, write_files


def write_identified(found: Identification, path: str | Path) -> None:
    """Write the action file (TOML) of an identification, whole or not at all; a file of that name is replaced.

    Parameters
    ----------
    found : Identification
    path : file to write, ending in .toml

    Raises
    ------
    ValidationInputError
        Another ending, or a folder that is not there.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> validation.write_identified(found, "identified.toml")
    """
    found.save(check_target(path))


def write_reading(
    found: Identification,
    path: str | Path,
    ranked: Sequence[Prospect] = (),
    refused: Sequence[str] = (),
) -> dict[str, Path]:
    """Write the action file and, under the same name with the ending ``.html``, its page, both or neither; older files
    are replaced. Return ``action`` and ``page`` -> path. ``ranked``, ``refused``: of `prospects`.

    Parameters
    ----------
    found : Identification
    path : action file to write, ending in .toml
    ranked, refused : what could be recorded next, see `validation.infer.further.prospects`

    Returns
    -------
    dict
        ``action`` and ``page`` -> path.

    Raises
    ------
    ValidationInputError
        Another ending, a folder that is not there or cannot be written; nothing is left half-written.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> validation.write_reading(found, "identified.toml")["page"].name
    'identified.html'
    """
    target = check_target(path)
    page = target.with_suffix(".html")
    texts: dict[str, str | bytes] = {
        target.name: identified_text(found),
        page.name: render_identification(found, ranked, refused),
    }
    write_files(target.parent, texts)
    return {"action": target, "page": page}
