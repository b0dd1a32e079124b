"""The table of a film's uncertainty in the terminal."""

from __future__ import annotations

import re

import numpy as np

import vision
from pianorig import workflows
from vision.uncertainty.budget import TERMS


def test_every_number_of_the_budget_stands_under_its_angle_in_a_terminal_of_100_columns() -> None:
    """Eight bodies of long names, all terms: more angles than one row holds; a distinct value for each."""
    bodies = ("whippen", *(f"repetition lever {i}" for i in range(7)))
    values = {
        name: np.radians(1e-3) * (100.0 * k + 10.0 * np.arange(8) + 0.5)[None].repeat(3, 0)
        for k, name in enumerate(TERMS)
    }
    nothing = {name: np.full((3, 8), np.nan) for name in TERMS}
    relative = {name: values[name] * 2.0 for name in TERMS}
    for name in TERMS:
        relative[name][:, 0] = np.nan  # has no parent
    for of_parents in (nothing, relative):
        lines = workflows.budget_lines(vision.ErrorBudget(bodies, values, of_parents, "camera", "shutter"))
        assert max(map(len, lines)) <= 100
        found: dict[tuple[str, int], list[float]] = {}
        named = [name for line in lines if line.split()[0] == "term" for name in re.split("  +", line.strip())[1:]]
        parents = [] if of_parents is nothing else [f"{body}/parent" for body in bodies[1:]]
        assert named == [*bodies, *parents]
        heads = [i for i, line in enumerate(lines) if line.split()[0] == "term"]
        for block, i in enumerate(heads):
            for line in lines[i + 1 : i + 1 + len(TERMS) + 1]:
                name, *numbers = line.split()
                found[name, block] = [float(number) for number in numbers]
        for k, name in enumerate(TERMS):
            of_bodies = (100.0 * k + 10.0 * np.arange(8) + 0.5).tolist()
            expected = of_bodies if of_parents is nothing else of_bodies + [2.0 * one for one in of_bodies[1:]]
            told = [number for block in range(len(heads)) for number in found[name, block]]
            np.testing.assert_allclose(told, expected, atol=0.051)
        total = [number for block in range(len(heads)) for number in found["total", block]]
        squares = [sum((100.0 * k + 10.0 * i + 0.5) ** 2 for k in range(len(TERMS))) for i in range(8)]
        np.testing.assert_allclose(total[:8], np.sqrt(squares), atol=0.051)
