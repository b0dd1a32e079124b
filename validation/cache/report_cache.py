"""A report whose inputs have not changed is not made again: its inputs' key is kept in a file beside it.

Whatever cannot be read or does not agree counts as changed, and the report is made again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rig.atomic_write import sha256_of_file, write_text
from rig.errors import RigInputError
from validation.cache.content_hash import code_sha256, result_key
from validation.errors import ValidationInputError

NAME = "report.inputs.json"
SCHEMA = "piano-action-rig report inputs 1"
PACKAGES = ("model", "rig", "validation")
SESSION_FILES = ("*.toml", "*.jsonl", "trial_*.h5", "derived/angles/*.h5")


@dataclass(frozen=True)
class StoredReport:
    verdict_lines: list[str]
    printed: list[str]
    files: dict[str, Path]
    made_utc: str


def report_folder(sessions: Sequence[str | Path], out: str | Path | None) -> Path:
    if out is not None:
        return Path(out)
    if len(sessions) != 1:
        raise ValidationInputError(f"{len(sessions)} sessions: name a folder for their report with `out`")
    return Path(sessions[0])


def inputs_sha256(sessions: Sequence[Path], actions: Sequence[str], options: Mapping[str, object]) -> str:
    """Key of everything a report depends on.

    Parameters
    ----------
    sessions : session folders
    actions : built-in names or paths of TOML files
    options : all other options of the report; plain values
    """
    recorded = [(session.name, _session_files(session)) for session in sessions]
    models = [(action, sha256_of_file(Path(action)) if Path(action).is_file() else "") for action in actions]
    text = json.dumps(dict(options), sort_keys=True, default=str)
    return result_key("report", tuple(map(code_sha256, PACKAGES)), (recorded, models, text))


def _session_files(session: Path) -> list[tuple[str, str]]:
    files = [file for pattern in SESSION_FILES for file in sorted(session.glob(pattern))]
    return [(file.relative_to(session).as_posix(), sha256_of_file(file)) for file in files]


def stored_report(folder: Path, inputs: str) -> StoredReport | None:
    """The report in a folder when it was made from these inputs and none of its files has been touched since."""
    try:
        content = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA or content["inputs_sha256"] != inputs:
            return None
        files = {str(name): folder / str(name) for name in content["files_sha256"]}
        if any(sha256_of_file(files[name]) != sha for name, sha in content["files_sha256"].items()):
            return None
        said, printed = ([str(line) for line in content[name]] for name in ("verdict_lines", "printed"))
        return StoredReport(said, printed, files, str(content["made_utc"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def store_report(folder: Path, inputs: str, report: StoredReport) -> str:
    """Write beside a report the hash ``inputs`` of what it was made from and those of its files; the reason why it
    could not be written, or an empty string."""
    content = {
        "schema": SCHEMA,
        "made_utc": report.made_utc,
        "inputs_sha256": inputs,
        "files_sha256": {name: sha256_of_file(path) for name, path in report.files.items()},
        "verdict_lines": report.verdict_lines,
        "printed": report.printed,
    }
    try:
        write_text(folder / NAME, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    except RigInputError as error:
        return f"report not kept for the next run: {error}"
    return ""
