"""Verdict and findings of a session's report, from its ``results.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

LARGEST_BYTES = 64_000_000  # 1,000 trials write about 30 MB
MOST_FINDINGS = 50
LONGEST = 600
"""Characters of one text that the page shows."""


@dataclass(frozen=True)
class ResultSummary:
    """What a report says, in short.

    Attributes
    ----------
    outcome : ``agrees``, ``error shown``, ``not judged``; several of them joined where models or sessions differ
    sentence : the headline
    findings : faults of the session in words, at most `MOST_FINDINGS`
    n_findings : how many there are
    rejected : trial → whether it had been rejected when the report was made
    seals : name of a trial's file without its ending → its seal then
    problem : why the file cannot be used; empty where it can
    """

    outcome: str = ""
    sentence: str = ""
    findings: tuple[str, ...] = ()
    n_findings: int = 0
    rejected: Mapping[int, bool] = field(default_factory=dict)
    seals: Mapping[str, str] = field(default_factory=dict)
    problem: str = ""


def shortened(text: object) -> str:
    """Text on one line, of bounded length."""
    words = " ".join(str(text).split())
    return words if len(words) <= LONGEST else words[: LONGEST - 1] + "…"


def read_results(path: Path) -> ResultSummary | None:
    """Read a ``results.json``; None where there is none."""
    if not path.is_file():
        return None
    try:
        size = path.stat().st_size
        if size > LARGEST_BYTES:
            return ResultSummary(
                problem=f"results.json has {size / 1e6:.0f} MB, at most {LARGEST_BYTES / 1e6:.0f} read"
            )
        return _summary(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        return ResultSummary(problem=f"results.json cannot be read ({shortened(error)}); make the report again")


def _summary(content: dict[str, Any]) -> ResultSummary:
    lines = content["verdict_lines"]
    texts = [shortened(row["text"]) for row in content["tables"]["findings"]]
    texts = list(dict.fromkeys(texts))  # a fault of the session stands once for each model
    outcomes = dict.fromkeys(shortened(result.get("outcome", "")) for result in content["results"])
    return ResultSummary(
        outcome=", ".join(text for text in outcomes if text),
        sentence=shortened(lines[0]) if lines else "",
        findings=tuple(texts[:MOST_FINDINGS]),
        n_findings=len(texts),
        rejected={int(row["trial"]): str(row["reason"]).startswith("rejected") for row in content["tables"]["trials"]},
        seals=dict(content["results"][0]["provenance"]["trials_sha256"]),
    )
