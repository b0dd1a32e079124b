"""Evaluation of a self-test's data: joined blocks, the time of a step, the likely cause of a wrong stroke."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.backend import Block
from rig.configuration.channels import BODIES
from rig.configuration.rig_file import RigConfig

PUSHES, PUSH_S, PAUSE_S, LEAD_S = 8, 0.15, 0.15, 0.3


def push_train(volts: float, rate_hz: float) -> NDArray[np.float64]:
    """Return the motor command of a row of equal gentle pushes, V, on the sample clock."""
    one = np.concatenate((np.full(int(PUSH_S * rate_hz), volts), np.zeros(int(PAUSE_S * rate_hz))))
    return np.concatenate((np.zeros(int(LEAD_S * rate_hz)), np.tile(one, PUSHES), np.zeros(int(0.1 * rate_hz))))


def push_response(force_n: NDArray[np.float64], rate_hz: float, delay: int) -> tuple[NDArray[np.float64], float]:
    """Return the mean response to one push, N above the force before it, from the push on, and its plateau, N."""
    lead, push = int(LEAD_S * rate_hz), int(PUSH_S * rate_hz)
    period = push + int(PAUSE_S * rate_hz)
    rows = [force_n[lead + i * period + delay :][:period] for i in range(PUSHES)]
    before = [force_n[lead + i * period - period // 4 : lead + i * period].mean() for i in range(PUSHES)]
    shortest = min(row.size for row in rows)
    response = np.mean([row[:shortest] - zero for row, zero in zip(rows, before, strict=True)], axis=0)
    return response, float(response[push // 3 : push - 2].mean())


def encoder_advice(config: RigConfig, body: int, turned_rad: float) -> str:
    """Return the likely cause of a wrong stroke, from the counts that each mistake would give."""
    if config.selftest is None:
        return ""
    encoders, strokes, tolerance = config.encoders, config.selftest.stroke_rad, config.selftest.stroke_tolerance
    expected = [s / (2 * np.pi) * e.counts_per_revolution for s, e in zip(strokes, encoders, strict=True)]
    counts = turned_rad / (2 * np.pi) * encoders[body].counts_per_revolution

    def like(other: float) -> bool:
        return abs(counts - other) <= tolerance * abs(other)

    if abs(counts) < 0.02 * abs(expected[body]):
        return "does not move: look at its plug, supply and terminals"
    if like(-expected[body]):
        return "turns the wrong way: change its sign, or exchange A and B"
    for other, theirs in enumerate(expected):
        if other != body and (like(theirs) or like(-theirs)):
            return f"reads like the {BODIES[other]}: its cable or terminals are swapped with the {BODIES[other]}'s"
    ratio = abs(counts / expected[body])
    if min(abs(ratio / 4 - 1), abs(4 * ratio - 1)) <= tolerance:
        return f"wrong scale by {ratio:.3g}: counts_per_revolution must count all four edges, four for each line"
    return f"wrong scale by {ratio:.3g}: look at counts_per_revolution and the decoding"


def joined(blocks: list[Block]) -> Block:
    """Join successive blocks to one."""
    return Block(
        blocks[0].first_sample,
        np.concatenate([block.force_n for block in blocks]),
        np.concatenate([block.force_raw for block in blocks]),
        np.concatenate([block.encoder_count for block in blocks]),
    )
