"""The regulated action, whose feel is looked at."""

from __future__ import annotations

import pytest

import model


@pytest.fixture(scope="session")
def regulated() -> model.Action:
    return model.load_action("hirschkorn2004-regulated")
