"""The page of figures: written from ``results.jsonl``, where every figure has its machine, date, command and commit.

    python -m benchmarks figures                                  # write docs/figures.md
    python -m benchmarks all [--minutes M]                        # measure again what is older than its code; goes on
    python -m benchmarks figures --row NAME --figure "4.1 ms"     # a figure read off by hand: stamped, then the page

A benchmark that makes a figure itself stores it with ``--write``. A row says on the page that the code it measures has
changed since (`measures` of the benchmark in ``registry.toml``, or of the row): its statements, not what is written
about them, nor where a file lies.
"""

from __future__ import annotations

import ast
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks" / "results.jsonl", ROOT / "docs" / "figures.md"
HEAD = """# Figures

Measured figures that the pages cite, each with the command that prints it. Made by `python -m benchmarks figures` from
`benchmarks/results.jsonl`, which also names the machine: do not edit. Two cores with other work beside it; times are of
the processor.
**stale**: measured before the last change of what it measures, by the commit named.
"""
MARK = re.compile(r"; \*\*stale\*\*: \w+")
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
    written = (f":!{path.relative_to(ROOT).as_posix()}" for path in (RESULTS, PAGE))
    changed = "+" if git("status", "--porcelain", "--untracked-files=no", "--", ".", *written) else ""
    row |= {"figure": figure, "command": command or row["command"], "machine": machine()}
    row |= {"date": datetime.now(UTC).date().isoformat(), "commit": git("rev-parse", "--short=8", "HEAD") + changed}
    RESULTS.write_text("".join(json.dumps(one, ensure_ascii=False) + "\n" for one in known), encoding="utf-8")


@cache
def statements(commit: str, file: str) -> str:
    """What a file makes a program do: Python without comments, docstrings and form; empty where there is nothing."""
    text = git("show", f"{commit}:{file}")
    if not file.endswith((".py", ".pyi")):
        return text
    tree = ast.parse("" if file.endswith(".pyi") else text)
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            node.body = [one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
    return ast.dump(tree) if tree.body else ""


def changed_since(row: Row, measures: Sequence[str]) -> str:
    """The last commit at what a row measures, if its statements are others than at the row's own; else empty."""
    own, head = row["commit"].rstrip("+"), git("rev-parse", "HEAD")
    if git("cat-file", "-t", own) != "commit":
        return "unknown"
    gone, new = set[str](), set[str]()  # of files that were deleted, added, moved
    for line in git("diff", "--name-status", "--no-renames", own, head, "--", *measures).splitlines():
        kind, file = line.split("\t")
        before, now = statements(own, file), statements(head, file)
        if kind == "M" and before != now:
            gone, new = {before}, {now}
            break
        if kind != "M":
            gone, new = gone | {before}, new | {now}
    return git("log", "-1", "--format=%h", f"{own}..HEAD", "--", *measures) if gone - {""} != new - {""} else ""


def page(known: Sequence[Row], later: Sequence[str]) -> str:
    """The page's text; ``later`` says of each row which commit changed its code since."""
    out, section = [HEAD], None
    for row, commit in zip(known, later, strict=True):
        if row["section"] != section:
            section = row["section"]
            out.append(f"\n## {section}\n" if section else "")
            out += ["| quantity | figure | date, commit | command |", "|---|---|---|---|"]
        mark = f"; **stale**: {commit}" if commit else ""
        when = f"{row['date']}, {row['commit']}{mark}"
        cells = (row["quantity"], row["figure"], when, row["command"])
        out.append(f"| {' | '.join(cells)} |")
    return "\n".join(out) + "\n"


def later_commits(known: Sequence[Row], registry: dict[str, dict[str, Any]]) -> list[str]:
    """Last commit at what each row measures, where that changed since the row was measured; else empty."""
    return [changed_since(row, row.get("measures") or registry[row["benchmark"]]["measures"]) for row in known]


def write(registry: dict[str, dict[str, Any]]) -> None:
    """Write the page, every row held against the history of its code."""
    known = rows()
    later = later_commits(known, registry)
    PAGE.write_text(page(known, later), encoding="utf-8")
    print(f"{PAGE.relative_to(ROOT)}: {len(later)} figures, {sum(map(bool, later))} older than their code")


def measure_stale(registry: dict[str, dict[str, Any]], minutes: float) -> int:
    """Run the command of each row older than its code, and store its figure; how many rows are left."""
    began, left, known = time.monotonic(), 0, rows()
    for row, later in zip(known, later_commits(known, registry), strict=True):
        words = shlex.split(row["command"].strip("`"))
        if not later:
            continue
        if words[:3] != ["python", "-m", "benchmarks"] or not row["benchmark"] or "--quick" in words:
            print(f"{row['row']}: read off by hand: {row['command']}", flush=True)
            left += 1
        elif time.monotonic() - began > 60.0 * minutes:
            left += 1
        else:
            print(f"--- {row['row']}: {row['command']}", flush=True)
            subprocess.run([sys.executable, *words[1:], "--write"], cwd=ROOT, check=False)
    return left
