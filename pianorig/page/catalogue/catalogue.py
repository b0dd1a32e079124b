"""The sessions below a folder: rows for the table, and the way from a name in a request to a folder on disk."""

from __future__ import annotations

import os
from pathlib import Path

from pianorig.errors import CommandInputError
from pianorig.page.catalogue.session_row import REPORT, SessionRow, read_row
from rig.session.folder import FILM_SUFFIXES

SESSION_FILE = "session.toml"
COMPARISONS = "comparisons"
"""Folder, among the sessions, of reports of several of them."""
GIVEN_OUT = {
    ".html": "text/html; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".nc": "application/octet-stream",
}
"""Files of a report that are given out, and as what."""

Fingerprint = tuple[tuple[str, int, int], ...]


class UnknownName(ValueError):
    """A name in a request that is not that of a session or of a report's file."""


class Catalogue:
    """Sessions in a folder, read again only where a file has changed.

    Parameters
    ----------
    folder : where the sessions are; each a folder with a ``session.toml``

    Raises
    ------
    CommandInputError : there is no such folder, or it is a session itself
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise CommandInputError(
                f"{folder}: no such folder; name the folder that holds your sessions, or record one:  pianorig demo"
            )
        if (folder / SESSION_FILE).is_file():
            raise CommandInputError(f"{folder}: is a session itself; name the folder above it, {folder.parent}")
        self.root = folder.absolute()
        self._known: dict[str, tuple[Fingerprint, SessionRow]] = {}

    def names(self) -> list[str]:
        """Names of the folders that hold a ``session.toml``."""
        with os.scandir(self.root) as entries:
            return sorted(entry.name for entry in entries if self._is_session(entry))

    def rows(self) -> list[SessionRow]:
        """One row a session, newest first; sessions without a date last."""
        found = []
        for name in self.names():
            fingerprint = self._fingerprint(name)
            known = self._known.get(name)
            row = known[1] if known is not None and known[0] == fingerprint else read_row(self.root / name)
            self._known[name] = (fingerprint, row)
            found.append(row)
        return sorted(found, key=lambda row: row.created_utc, reverse=True)

    def folder(self, name: str) -> Path:
        """The folder of a session, which must be one of `names`.

        Raises
        ------
        UnknownName : it is none of them
        """
        if name not in self.names():
            raise UnknownName(f"no session {name[:120]!r} in {self.root}")
        return self.root / name

    def films(self) -> list[str]:
        """Names of the films that lie in the folder itself, beside the sessions."""
        with os.scandir(self.root) as entries:
            return sorted(entry.name for entry in entries if self._is_film(entry))

    def film(self, name: str) -> Path:
        """A film that lies on its own, which must be one of `films`.

        Raises
        ------
        UnknownName : it is none of them
        """
        if name not in self.films():
            raise UnknownName(f"no film {name[:120]!r} in {self.root}")
        return self.root / name

    def report_file(self, name: str, path: str = REPORT) -> tuple[Path, str]:
        """A file of a session's report, and its media type; it lies in the session's folder, also behind links.

        Raises
        ------
        UnknownName : no such file, or not one of a report
        """
        return self._given_out(self.folder(name), path)

    def comparisons(self) -> list[str]:
        """Names of the reports of several sessions, newest first."""
        folder = self.root / COMPARISONS
        if not folder.is_dir():
            return []
        with os.scandir(folder) as entries:
            return sorted((entry.name for entry in entries if Path(entry.path, REPORT).is_file()), reverse=True)

    def comparison_file(self, name: str, path: str = REPORT) -> tuple[Path, str]:
        """A file of the report of several sessions, as `report_file`.

        Raises
        ------
        UnknownName : no such report or file
        """
        if name not in self.comparisons():
            raise UnknownName(f"no comparison {name[:120]!r} in {self.root}")
        return self._given_out(self.root / COMPARISONS / name, path)

    @staticmethod
    def _given_out(report: Path, path: str) -> tuple[Path, str]:
        folder, name = report.resolve(), report.name
        try:
            file = (folder / path).resolve()
            inside = file.is_relative_to(folder) and file.is_file()
        except (OSError, ValueError) as error:  # a name that no file can have
            raise UnknownName(f"{name}: no file {path[:120]!r}") from error
        kind = GIVEN_OUT.get(file.suffix)
        if not inside or kind is None:
            raise UnknownName(f"{name}: no file {path[:120]!r} of a report")
        return file, kind

    @staticmethod
    def _is_session(entry: os.DirEntry[str]) -> bool:
        try:
            return entry.is_dir() and Path(entry.path, SESSION_FILE).is_file()
        except OSError:
            return False

    @staticmethod
    def _is_film(entry: os.DirEntry[str]) -> bool:
        try:
            return Path(entry.name).suffix.lower() in FILM_SUFFIXES and entry.is_file()
        except OSError:
            return False

    def _fingerprint(self, name: str) -> Fingerprint:
        try:
            with os.scandir(self.root / name) as entries:
                found = [(entry.name, entry.stat(follow_symlinks=False)) for entry in entries]
        except OSError:
            return ()
        return tuple(sorted((file, stat.st_size, stat.st_mtime_ns) for file, stat in found))
