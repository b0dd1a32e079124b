"""When causes are looked for: where a difference shows, always, or never."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from validation import compare
from validation.options import CompareOptions, ComparisonOptions


@pytest.mark.parametrize(("explain", "asked"), [(None, (False, True)), (True, (True, True)), (False, (False, False))])
def test_causes_are_looked_for_where_a_difference_shows_unless_told(
    explain: bool | None, asked: tuple[bool, bool]
) -> None:
    chosen = ComparisonOptions.from_keywords({"explain": explain})
    assert (chosen.wants_causes(False), chosen.wants_causes(True)) == asked


def test_the_former_keyword_says_the_new_one() -> None:
    former: CompareOptions = {"suspect": "parts"}  # type: ignore[typeddict-unknown-key]
    with pytest.raises(TypeError, match="is now explain .*effects=False"):
        ComparisonOptions.from_keywords(former)


def test_the_verdict_is_said_before_the_tables_are_made(make: SimpleNamespace, tmp_path: Path) -> None:
    session, truth = make.session(tmp_path / "s", n_trials=1, filmed=())
    said: list[str] = []
    options: CompareOptions = {"rivals": (), "explain": False, "keep_predictions": False, "progress": said.append}
    result = compare(session, truth.action, **options)
    heads = [line.partition(":")[0] for line in said]
    assert heads.index("predicted trial 1") < heads.index("verdict") < heads.index("scores of a perfect model")
    assert said[heads.index("verdict")] == f"verdict: {result.outcome}"
