"""Forces of hands on the virtual bench: of the operator in a self-test, and of a pianist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LIFTED_S = (0.4, 1.2)  # from, to: as the self-test asks its operator
PRESS_S = (1.8, 2.6, 3.0, 3.5)  # begin, key at the bottom, let go, key up again
PRESS_N = 2.5  # at the arm's tip: a gentle hand


def press_n(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.interp(time_s, PRESS_S, (0.0, PRESS_N, PRESS_N, 0.0))


def is_arm_lifted(time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (time_s >= LIFTED_S[0]) & (time_s < LIFTED_S[1])


PAUSE_S = (1.0, 2.5)  # least, most: this and what follows are a pianist's strokes by choice
PEAK_N = (3.0, 22.0)  # piano to forte
RISE_S = (0.03, 0.12)  # hard to soft
HOLD_N = (2.0, 4.0)  # more than keeps a key down
HOLD_S = (0.05, 0.4)  # staccato to tenuto
LET_GO_S = 0.06  # of the finger
_STREAM = 9


class VirtualPianist:
    """The force of one player over time; strokes are drawn as they come."""

    def __init__(self, seed: int, trial: int) -> None:
        self._random = np.random.default_rng([seed, trial, _STREAM])
        self._begun_s = 0.0
        self._strokes: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []

    def press_n(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force of the pianist at the arm's tip (n,), N, positive downwards, at rising times (n,), s since the trial
        began; calls must follow in time, as past strokes are forgotten."""
        while not self._strokes or self._strokes[-1][0][0] <= time_s[-1]:
            self._strokes.append(self._draw_stroke())
        while self._strokes[0][0][-1] < time_s[0]:
            self._strokes.pop(0)
        force = np.zeros(time_s.size)
        for at, values in self._strokes:
            force += np.interp(time_s, at, values, left=0.0, right=0.0)
        return force

    def _draw_stroke(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw the next stroke, times, s, and forces, N, (k,) each: a pause, a push, a hold, the finger lifted."""
        pause, peak, rise, hold_n, hold = (self._random.uniform(*b) for b in (PAUSE_S, PEAK_N, RISE_S, HOLD_N, HOLD_S))
        begin = self._begun_s + pause
        phase = np.linspace(0.0, 1.0, 41)  # points of a push: lines between them
        push = np.maximum(peak * np.sin(np.pi * phase) ** 2, np.where(phase > 0.5, min(hold_n, peak), 0.0))
        at = np.concatenate((begin + rise * 2 * phase, [begin + 2 * rise + hold, begin + 2 * rise + hold + LET_GO_S]))
        self._begun_s = float(at[-1])
        return at, np.concatenate((push, [push[-1], 0.0]))
