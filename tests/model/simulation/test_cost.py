"""What a run costs, by counts of work: in proportion to the time in which something moves, nothing for rest."""

from __future__ import annotations

import numpy as np

import model
from tests.model.conftest import read_table


def work(action: model.Action, time: np.ndarray, force: np.ndarray) -> np.ndarray:
    solution = model.simulate(action, time, force, tolerance=1e-4, output_time_s=time[-1:])
    count = solution.counters
    assert count["time_at_rest"] > 0.0
    return np.array([count["n_steps"] + count["n_rejected"], count["n_rhs"], count["n_contact_evaluations"]])


def test_cost_is_in_proportion_to_the_blows_not_to_the_minute(action: model.Action) -> None:
    table = read_table("forte_force.csv")
    one = work(action, np.append(table[:, 0], 60.0), np.append(table[:, 1], 0.0))
    for count in (2, 5, 10):
        starts = 6.0 * np.arange(count)
        time = np.append(np.concatenate([s + table[:, 0] for s in starts]), 60.0)
        force = np.append(np.tile(table[:, 1], count), 0.0)
        np.testing.assert_allclose(work(action, time, force), count * one, rtol=0.05)
