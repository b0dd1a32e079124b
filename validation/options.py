"""Options of a comparison: keywords of the public functions, and the one frozen record they become at the door."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from typing import Any, TypedDict

import model
from model.keywords import refuse_unknown
from model.tolerance import DEFAULT_TOLERANCE
from validation.conventions import Array
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import U_REST_LEVEL_M
from validation.prediction.model_under_test import RIVALS, StandIns


class CompareOptions(TypedDict, total=False):
    """Keywords of every comparison, see `ComparisonOptions` and `validation.prediction.model_under_test.StandIns`."""

    tolerance: float
    predict: Callable[..., model.Solution] | None
    rest_state: Callable[..., model.RestState] | None
    geometry: Callable[[model.Action, Array], ActionGeometry] | None
    rivals: tuple[str, ...]
    budget: bool
    explain: bool | None
    effects: bool
    by_motion: bool
    further: bool
    keep_predictions: bool
    u_rest_level_m: float
    now: Callable[[], datetime]
    condition: str | None
    relevant: Mapping[str, float]
    progress: Callable[[str], None] | None


def utc_now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True)
class ComparisonOptions:
    """Options of a comparison, as documented by `validation.compare`.

    ``paired`` is set where several models are compared: then each is also scored under drawn errors of force and
    sensors, which the comparison of two models needs.
    """

    tolerance: float = DEFAULT_TOLERANCE
    rivals: tuple[str, ...] = RIVALS
    budget: bool = True
    explain: bool | None = None
    effects: bool = True
    by_motion: bool = False
    further: bool = False
    keep_predictions: bool = True
    u_rest_level_m: float = U_REST_LEVEL_M
    condition: str | None = None
    relevant: Mapping[str, float] = field(default_factory=dict)
    stand_ins: StandIns = StandIns()
    now: Callable[[], datetime] = utc_now
    progress: Callable[[str], None] | None = None
    paired: bool = False

    @classmethod
    def from_keywords(cls, keywords: CompareOptions, function: str = "validation.compare") -> ComparisonOptions:
        """The record of the keywords of a public function, which the `TypeError` for an unknown one names."""
        values: dict[str, Any] = dict(keywords)
        if "suspect" in values:
            raise TypeError(
                "suspect: is now explain (True: always, False: never, None: where a difference shows), and for "
                '"parts" effects=False'
            )
        refuse_unknown(function, values, CompareOptions.__annotations__)
        injected = {field.name: values.pop(field.name) for field in fields(StandIns) if field.name in values}
        return cls(stand_ins=StandIns(**injected), **values)

    def wants_causes(self, is_difference_shown: bool) -> bool:
        return is_difference_shown if self.explain is None else self.explain

    def say(self, text: str) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(text)
