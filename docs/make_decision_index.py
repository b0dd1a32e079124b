"""Write `docs/decisions/README.md`: every decision with its number, date and status.

Run after adding or superseding one:  python docs/make_decision_index.py
A decision begins with ``# NUMBER. Title`` and a line ``Date: YYYY-MM-DD · Status: accepted`` (or ``superseded by
[N](file)``); a test holds the files to that and the index to the files.
"""

from __future__ import annotations

import re
from pathlib import Path

FOLDER = Path(__file__).parent / "decisions"
HEAD = re.compile(r"# (\d+)\. (.+)\n\nDate: (\d{4}-\d\d-\d\d) · Status: (.+)\n")
INTRODUCTION = """# Decisions

What a newcomer would question, and why it is as it is. A decision is not rewritten when it no longer holds: a new one
supersedes it, and its status says so. Made by `python docs/make_decision_index.py`.

| No. | Decision | Date | Status |
|---:|---|---|---|
"""


def index() -> str:
    """The index as Markdown; raises ValueError for a file without number, date and status."""
    rows = []
    for path in sorted(FOLDER.glob("[0-9]*.md")):
        found = HEAD.match(path.read_text(encoding="utf-8"))
        if found is None or int(found[1]) != int(path.name[:4]):
            raise ValueError(f"{path.name}: needs '# N. Title', a blank line, 'Date: YYYY-MM-DD · Status: …'")
        number, title, date, status = found.groups()
        rows.append(f"| {number} | [{title}]({path.name}) | {date} | {status} |\n")
    return INTRODUCTION + "".join(rows)


if __name__ == "__main__":
    (FOLDER / "README.md").write_text(index(), encoding="utf-8")
