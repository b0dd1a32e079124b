"""The page of figures: written from ``results.jsonl``, where every figure has its machine, date, command and commit.

    python -m benchmarks figures                                  # write docs/figures.md
    python -m benchmarks figures --row NAME --figure "4.1 ms"     # a figure read off by hand: stamped, then the page

A benchmark that makes a figure itself stores it with ``--write``. A row whose commit is older than the last one that
touched the code it measures (`measures` of the benchmark in ``registry.toml``, or of the row) says so on the page.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks" / "results.jsonl", ROOT / "docs" / "figures.md"
HEAD = """# Figures

Made by `python -m benchmarks figures` from `benchmarks/results.jsonl`: do not edit. The command in each row reproduces
its figure. Machine: 2 cores at 2.5 GHz unless said; busy: it did other work as well. **stale**: measured before the
last change of what it measures, by the commit named. Up to 2026-11-26 a row's commit is the one that wrote it down.

![Time of a blow, a batch, derivatives, a fit, a film and a report beside peers and floors](images/diagrams.svg)

`python -m benchmarks diagrams --out docs/images/diagrams.svg` draws it, `scaling` says how time and memory grow.
"""
MARK = re.compile(r"; \*\*stale\*\*: \w+")
USUAL = "2 cores at 2.5 GHz, "
Row = dict[str, Any]


def git(*arguments: str) -> str:
    """Output of a git command in this checkout; empty where there is no git."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def machine() -> str:
    """Processor, cores and load."""
    info = Path("/proc/cpuinfo")
    names = re.findall(r"^model name\s*: (.*)$", info.read_text(), re.MULTILINE) if info.exists() else []
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores{load}"


def rows() -> list[Row]:
    """All rows of the page."""
    return [json.loads(line) for line in RESULTS.read_text(encoding="utf-8").splitlines()]


def store(name: str, figure: str, command: str = "", benchmark: str = "") -> None:
    """Give a row a new figure, with today's date, this machine and commit; a new name is a new row.

    Raises
    ------
    SystemExit
        For a new row without a command.
    """
    known = rows()
    row = next((one for one in known if one["row"] == name), None)
    if row is None:
        if not command:
            raise SystemExit(
                f"--row: found {name}, allowed {', '.join(r['row'] for r in known)}, or new with --command"
            )
        row = {"row": name, "section": "", "quantity": name, "benchmark": benchmark}
        known.append(row)
    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    row |= {"figure": figure, "command": command or row["command"], "machine": machine()}
    row |= {"date": datetime.now(UTC).date().isoformat(), "commit": git("rev-parse", "--short=8", "HEAD") + changed}
    RESULTS.write_text("".join(json.dumps(one, ensure_ascii=False) + "\n" for one in known), encoding="utf-8")


def changed_since(row: Row, measures: Sequence[str]) -> str:
    """The last commit after a row's own that touched what it measures; empty where there is none."""
    return git("log", "-1", "--format=%h", f"{row['commit'].rstrip('+')}..HEAD", "--", *measures)


def page(known: Sequence[Row], later: Sequence[str]) -> str:
    """The page's text; ``later`` says of each row which commit changed its code since."""
    out, section = [HEAD], None
    for row, commit in zip(known, later, strict=True):
        if row["section"] != section:
            section = row["section"]
            out.append(f"\n## {section}\n" if section else "")
            out += ["| quantity | figure | machine | date, commit | command |", "|---|---|---|---|---|"]
        mark = f"; **stale**: {commit}" if commit else ""
        when = f"{row['date']}, {row['commit']}{mark}"
        cells = (row["quantity"], row["figure"], row["machine"].removeprefix(USUAL), when, row["command"])
        out.append(f"| {' | '.join(cells)} |")
    return "\n".join(out) + "\n"


def write(registry: dict[str, dict[str, Any]]) -> None:
    """Write the page, every row held against the history of its code."""
    known = rows()
    measured = [row.get("measures") or registry.get(row["benchmark"], {}).get("measures", ()) for row in known]
    later = [changed_since(row, paths) if paths else "" for row, paths in zip(known, measured, strict=True)]
    PAGE.write_text(page(known, later), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(known)} figures, {sum(map(bool, later))} older than their code")
