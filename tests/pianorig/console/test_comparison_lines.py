"""What a comparison prints of several models: whole names, whole readings, every sentence once."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from pianorig.console.output import MOST_COLUMNS
from pianorig.workflows import comparison_lines
from validation.result import DIFFERS_PERHAPS

MODEL = "hirschkorn2004 (contact04.second.x=-0.2182)"


def test_names_and_readings_of_several_models_are_not_cut_and_the_outcome_is_said_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = ("hammer speed at impact (m/s)", "−0.01 ± 0.07", "± 0.12", DIFFERS_PERHAPS)
    monkeypatch.setattr("validation.report.overview.quantity_rows", lambda result: [row])
    results = [
        SimpleNamespace(
            session_name="example_forte", action_name=name, findings=pd.DataFrame({"kind": []}), advice=(),
            outcome=DIFFERS_PERHAPS, sentence=f"{DIFFERS_PERHAPS}. Model error (95 % interval): let-off 2 ± 1 mm.",
        )
        for name in ("hirschkorn2004", MODEL)
    ]  # fmt: skip
    side = SimpleNamespace(results=results, compared_lines=[], refused=(), notes=())
    lines = comparison_lines(side)  # type: ignore[arg-type]
    assert max(map(len, lines)) <= MOST_COLUMNS
    assert f"example_forte, {MODEL}:" in lines and sum("…" in line for line in lines) == 0
    assert sum(line.startswith("hammer speed at impact (m/s)") for line in lines) == 2
    assert " ".join(" ".join(lines).split()).count("cannot be told") == 2
