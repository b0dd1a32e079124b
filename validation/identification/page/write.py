"""Writing an identification: the action file and its page, both or neither; its tables in the manner of PEtab."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from validation.identification.further.shrink import Prospect
from validation.identification.outcome.action_file import identified_text
from validation.identification.outcome.result import Identification
from validation.identification.outcome.target_file import check_target
from validation.identification.page.render import render_identification
from validation.identification.petab.write import petab_texts
from validation.report.files import check_folder, write_files


def write_reading(
    found: Identification,
    path: str | Path,
    ranked: Sequence[Prospect] = (),
    refused: Sequence[str] = (),
    drawn: Sequence[str] = (),
) -> dict[str, Path]:
    """Write the action file and, under the same name with the ending ``.html``, its page.

    Parameters
    ----------
    found : Identification
    path : action file to write, ending in .toml
    ranked, refused : what could be recorded next, see `validation.identification.further.shrink.prospects`
    drawn : lines of `validation.draw_lines`, where draws were made

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
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> validation.write_reading(found, "identified.toml")["page"].name
    'identified.html'
    """
    target = check_target(path)
    page = target.with_suffix(".html")
    texts: dict[str, str | bytes] = {
        target.name: identified_text(found),
        page.name: render_identification(found, ranked, refused, drawn),
    }
    write_files(target.parent, texts)
    return {"action": target, "page": page}


def write_petab(found: Identification, folder: str | Path) -> dict[str, Path]:
    """Write the data and parameters of an identification as tables in the manner of PEtab 1.

    Parameters
    ----------
    found : Identification
    folder : path
        Made if it is not there.

    Returns
    -------
    dict
        Name -> path.

    Raises
    ------
    ValidationInputError
        The folder cannot be written; nothing is left half-written.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> sorted(validation.write_petab(found, "tables"))[:2]
    ['README.txt', 'conditions.tsv']
    """
    target = Path(folder)
    check_folder(target)
    return write_files(target, petab_texts(found.details.problem, found.details.fitted, found.details.sources.seals))
