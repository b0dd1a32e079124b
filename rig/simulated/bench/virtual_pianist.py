"""The virtual pianist: strokes of random strength and length, as somebody would play who tries an action.

With ``sim://?hand=plays`` this happens in every acquisition in which the motor has no task, as in ``pianorig record
--passive``. A stroke is a force on the arm's tip, so that it reaches the key through the load cell; the same seed and
trial give the same strokes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PAUSE_S = (1.0, 2.5)
PEAK_N = (3.0, 22.0)
RISE_S = (0.03, 0.12)
HOLD_N = (2.0, 4.0)
HOLD_S = (0.05, 0.4)
LET_GO_S = 0.06
_STREAM = 9


class VirtualPianist:
    """The force of one player over time; strokes are drawn as they come."""

    def __init__(self, seed: int, trial: int) -> None:
        self._random = np.random.default_rng([seed, trial, _STREAM])
        self._begun_s = 0.0
        self._strokes: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []

    def press_n(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force at the arm's tip, N, at successive times (n,)."""
        while not self._strokes or self._strokes[-1][0][0] <= time_s[-1]:
            self._strokes.append(self._next())
        while self._strokes[0][0][-1] < time_s[0]:
            self._strokes.pop(0)
        force = np.zeros(time_s.size)
        for at, values in self._strokes:
            force += np.interp(time_s, at, values, left=0.0, right=0.0)
        return force

    def _next(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw a stroke: quiet, a push that grows and falls like a hand's, a hold, the finger lifted."""
        pause, peak, rise, hold_n, hold = (self._random.uniform(*b) for b in (PAUSE_S, PEAK_N, RISE_S, HOLD_N, HOLD_S))
        begin = self._begun_s + pause
        phase = np.linspace(0.0, 1.0, 41)
        push = np.maximum(peak * np.sin(np.pi * phase) ** 2, np.where(phase > 0.5, min(hold_n, peak), 0.0))
        at = np.concatenate((begin + rise * 2 * phase, [begin + 2 * rise + hold, begin + 2 * rise + hold + LET_GO_S]))
        self._begun_s = float(at[-1])
        return at, np.concatenate((push, [push[-1], 0.0]))
