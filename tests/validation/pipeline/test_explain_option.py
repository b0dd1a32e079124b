"""When causes are looked for: where a difference shows, always, or never."""

from __future__ import annotations

import pytest

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
