"""Errors of trials without the channels that cannot be used."""

from __future__ import annotations

import numpy as np

from validation.verdict.error_draws import TrialErrors, select_usable_errors
from validation.verdict.quantities import ANGLES, QUANTITIES, branch_mask


def trial() -> TrialErrors:
    n = len(QUANTITIES)
    masks = {q.name: np.array([True, False]) for q in ANGLES}
    travel = {q.channel: 0.1 for q in ANGLES}
    values = np.arange(n - len(ANGLES), dtype=float)
    whole = branch_mask(["key", "whippen", "hammer"])
    return TrialErrors(np.arange(1.0, n + 1.0), masks, travel, values, whole, whole)


def test_a_channel_takes_its_angles_events_and_outcomes_along_and_leaves_the_rest() -> None:
    before = trial()
    found = select_usable_errors({3: before, 5: trial()}, {(3, "hammer"), (3, "jack")})
    one = found[3]
    for k, q in enumerate(QUANTITIES):
        gone = q.channel in ("hammer", "jack") if k < len(ANGLES) else "hammer" in q.bodies or "jack" in q.bodies
        assert np.isnan(one.errors[k]) == gone
        if k < len(ANGLES):
            assert (q.name in one.masks) == (not gone)
        else:
            assert np.isnan(one.values[k - len(ANGLES)]) == gone
    assert "hammer" not in one.travel and "key" in one.travel
    assert one.known == branch_mask(["key", "whippen"]) and one.branch == before.branch & one.known
    assert found[5].errors.tolist() == before.errors.tolist()
    assert np.isfinite(before.errors).all()  # what is left out is left in the original


def test_a_trial_without_a_usable_encoder_is_left_out() -> None:
    lost = {(3, name) for name in ("key", "whippen", "hammer")}
    assert list(select_usable_errors({3: trial(), 4: trial()}, lost)) == [4]
