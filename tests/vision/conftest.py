"""The renderer of the stress benchmark, which shares no code with `vision`."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import pytest

from benchmarks import tracking_stress as stress_films


@pytest.fixture(scope="session")
def stress() -> ModuleType:
    """A film is drawn once."""
    stress_films.__dict__["stress_film"] = cache(stress_films.stress_film)
    return stress_films
