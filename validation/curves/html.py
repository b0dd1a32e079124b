"""A result as a notebook shows it: its verdict."""

from __future__ import annotations

import html
from collections.abc import Sequence

MOST_WARNINGS = 5


def result_html(session: str, action: str, sentence: str, lines: Sequence[str], warnings: Sequence[str]) -> str:
    """The verdict in HTML; every text is escaped."""
    head = f"<p><strong>{html.escape(action)} on {html.escape(session)}: {html.escape(sentence)}</strong></p>"
    body = "".join(f"<li>{html.escape(text)}</li>" for text in lines)
    parts = [head, f"<ul>{body}</ul>"] if body else [head]
    if warnings:
        shown = "".join(f"<li>{html.escape(text)}</li>" for text in warnings[:MOST_WARNINGS])
        more = len(warnings) - MOST_WARNINGS
        rest = f"<li>and {more} more in <code>result.warnings</code></li>" if more > 0 else ""
        parts.append(f"<p>Warnings:</p><ul>{shown}{rest}</ul>")
    return f"<div>{''.join(parts)}</div>"
