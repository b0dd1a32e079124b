"""Prediction of the next pose: constant acceleration, gaps, and the axes of the parent."""

from __future__ import annotations

import numpy as np

from vision.tracking.body_tracker import PlacementHistory, from_parent, in_parent


def test_prediction_follows_constant_acceleration_and_restarts_after_a_gap() -> None:
    trace = PlacementHistory()
    assert trace.predict(0) is None
    for k in range(3):
        trace.add(k, np.array([0.1 * k * k, 2.0 * k, -1.0]))
    np.testing.assert_allclose(trace.predict(3), [0.9, 6.0, -1.0])
    np.testing.assert_allclose(trace.predict(7), [0.4, 4.0, -1.0])
    trace.add(7, np.array([5.0, 5.0, 5.0]))
    np.testing.assert_allclose(trace.predict(8), [5.0, 5.0, 5.0])


def test_parent_axes_and_back() -> None:
    parent, child = np.array([0.3, 10.0, 20.0]), np.array([0.9, 14.0, 17.0])
    relative = in_parent(child, parent)
    np.testing.assert_allclose(from_parent(relative, parent), child)
    # the parent turns by 90 degrees about its centre: a child fixed to it goes with it
    turned = from_parent(
        in_parent(np.array([0.0, 13.0, 20.0]), np.array([0.0, 10.0, 20.0])), np.array([np.pi / 2, 10, 20])
    )
    np.testing.assert_allclose(turned, [np.pi / 2, 10.0, 23.0], atol=1e-12)
