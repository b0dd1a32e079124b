"""Writing the report of a comparison into a folder, and the whole job: compare, then write."""

from __future__ import annotations

from pathlib import Path

from validation.report.curve_files import curve_files
from validation.report.files import check_folder, write_files
from validation.report.render import ANIMATION, render_html
from validation.report.results import results_json, table_csv
from validation.result import ValidationResult
from validation.side_by_side import SideBySide, alone


def write_report(result: ValidationResult | SideBySide, folder: str | Path) -> ValidationResult | SideBySide:
    """Write the report of one result, or of several, into a folder and return it with its file names.

    Parameters
    ----------
    result : ValidationResult or SideBySide
    folder : path
        Made if it does not exist.

    Returns
    -------
    ValidationResult or SideBySide
        The same with ``files``.

    Raises
    ------
    ValidationInputError
        The folder cannot be written; nothing new is left behind.

    Examples
    --------
    >>> import validation
    >>> result = validation.compare("sessions/example_forte", budget=False, suspect=False)
    >>> validation.write_report(result, "written").files["results.json"].exists()
    True
    """
    if isinstance(result, SideBySide):
        return write_side_by_side(result, Path(folder))
    return write_side_by_side(alone(result), Path(folder)).results[0]


def write_side_by_side(side: SideBySide, folder: Path) -> SideBySide:
    """Write the page, the results for programs, every table and the curves."""
    check_folder(folder)
    texts: dict[str, str | bytes] = {f"tables/{name}.csv": table_csv(table) for name, table in side.tables.items()}
    texts.update(curve_files(side))
    texts["results.json"] = results_json(side)
    texts["report.html"] = render_html(
        side, animation=(folder / ANIMATION).is_file()
    )  # last: a page never points at tables that are not there yet
    return side.with_files(write_files(folder, texts))
