"""Shared fixtures of the model's tests: the printed action, its twin, random states near real motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import model
from tests.model.verification.reference_equations import Twin

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="session")
def action() -> model.Action:
    return model.load_action()


@pytest.fixture(scope="session")
def twin(action: model.Action) -> Twin:
    return Twin(action)


def random_states(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """States (q, v, force) spread over what a blow visits, with most contacts touched by some of them."""
    random = np.random.default_rng(seed)
    low = np.array([-0.03, 0.0, -0.1, 0.25, -0.1])
    high = np.array([0.035, 0.12, 0.35, 0.6, 0.32])
    scale = np.array([1.0, 2.0, 20.0, 10.0, 30.0])
    return [
        (random.uniform(low, high), scale * random.normal(size=5) * 10 ** random.uniform(-4, 0), random.uniform(-2, 60))
        for _ in range(count)
    ]


def read_table(name: str) -> np.ndarray:
    return np.loadtxt(DATA / name, delimiter=",", skiprows=1)
