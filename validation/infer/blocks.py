"""The linear model around one point: of each trial, how its curves change with everything that is not known.

Conventions: rows of a trial are channel after channel, (c m,) of its c channels, mostly three; columns are per prior
standard uncertainty. Common to all trials of a bench: errors of the force (moved like a parameter) and of each
encoder's scale and zero, as in `validation.prediction.joint_draws`, and of the film's scale. Common to all trials of a
session: the discrepancy, what the model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from validation.conventions import Array
from validation.infer.channels import SCALE, ZERO, error_shape
from validation.infer.observations import CHANNEL_NAMES, ENCODERS, FILM, ObservedTrial

FLOOR_RAD = 1e-5  # least size of a channel's response
SMOOTH = 5  # phases over which the size of the response is taken
LOST_RAD = 1e3  # standard uncertainty of what a film lost
SCALES = tuple(f"{CHANNEL_NAMES[c]} {'film scale' if c in FILM else SCALE}" for c in (*ENCODERS, *FILM))
INSTRUMENT = (*SCALES, *(f"{CHANNEL_NAMES[c]} {ZERO}" for c in ENCODERS))


@dataclass(frozen=True)
class Block:
    """One trial.

    Attributes
    ----------
    session : index of its session
    time_s : (m,) phases
    moved : (3 m, p) columns of what the fit moves
    held : (3 m, h) columns of laws that are fixed, and scatter from trial to trial all the same
    instrument : (3 m, 8) columns of `INSTRUMENT`
    own : (3 m, k) columns of the trial's own force: its offset, and its noise in parts; of its sensors' zeros
    white : (3 m,) variance of sensor noise, rad²
    size : (3, m) size of the response: root of the sum of squares of the columns of laws
    load : (m,) force on the key, of its greatest
    channels : which channels the rows are, as places in `CHANNEL_NAMES`
    driven : how many of ``own`` are of what drives the trial and of a film's clock, and can be run
    """

    session: int
    time_s: Array
    moved: Array
    held: Array
    instrument: Array
    own: Array
    white: Array
    size: Array
    load: Array
    channels: tuple[int, ...] = ENCODERS
    driven: int = 0

    def until(self, phase: int) -> Block:
        """The trial without what was measured from a phase on."""
        there = (np.arange(self.white.size) % self.time_s.size < phase)[:, None]
        kept = {name: getattr(self, name) * there for name in ("moved", "held", "instrument", "own")}
        return replace(self, **kept, white=np.where(there[:, 0], self.white, LOST_RAD**2))


def rows(curves: Array) -> Array:
    """(m, c, …) as (c m, …), channel after channel."""
    return np.moveaxis(curves, 1, 0).reshape(curves.shape[0] * curves.shape[1], *curves.shape[2:])


def residuals(trials: Sequence[ObservedTrial], curves: Sequence[Array]) -> list[Array]:
    """Measured less predicted, (3 m,) of each trial; 0 where lost."""
    return [rows(np.nan_to_num(t.change_rad - c)) for t, c in zip(trials, curves, strict=True)]


def make_blocks(
    trials: Sequence[ObservedTrial],
    jacobian: Sequence[Array],
    force_columns: Sequence[Array],
    laws: NDArray[np.bool_],
    held: Sequence[Array] = (),
) -> list[Block]:
    """Linear model of each trial (m samples, c channels; rows channel after channel): derivatives of its curves by z,
    ``jacobian`` (m, c, p), by its own drive, ``force_columns`` (m, c, k), by fixed laws, ``held`` (m, c, h); ``laws``
    (p,): which of z are."""
    out = []
    for k, t in enumerate(trials):
        m, c = t.change_rad.shape
        there = rows(np.isfinite(t.change_rad))
        moved = rows(jacobian[k]) * there[:, None]
        fixed = rows(held[k]) * there[:, None] if held else np.zeros((c * m, 0))
        instrument, zeros = _sensor_columns(t)
        white = np.where(there, rows(np.broadcast_to(t.u_white_rad, (m, c))) ** 2, LOST_RAD**2)
        out.append(
            Block(
                session=t.session,
                time_s=t.time_s,
                moved=moved,
                held=fixed,
                instrument=instrument,
                own=np.hstack([rows(force_columns[k]) * there[:, None], zeros]),
                white=white,
                size=_response_size(np.hstack([moved[:, laws], fixed]), m),
                load=_relative_load(t),
                channels=t.channels,
                driven=force_columns[k].shape[2],
            )
        )
    return out


def _sensor_columns(t: ObservedTrial) -> tuple[Array, Array]:
    """Columns of one trial, rad per standard uncertainty: of the errors `INSTRUMENT` that all trials share (c m, 8; 0
    for a key encoder whose errors are fitted), and of the zeros of its own c channels (c m, c)."""
    m = t.time_s.size
    out = np.zeros((len(t.channels) * m, len(INSTRUMENT)))
    own = np.zeros((len(t.channels) * m, len(t.channels)))
    for k, c in enumerate(t.channels):
        part, turned = slice(k * m, (k + 1) * m), np.nan_to_num(t.change_rad[:, k])
        moved = error_shape(ZERO, turned)
        own[part, k] = t.u_zero_rad[k] * moved
        if c == 0 and t.key_moves:  # errors of the key's encoder move like a parameter
            continue
        out[part, c] = turned * t.u_scale[k]
        if c not in FILM:
            out[part, len(SCALES) + c] = t.u_steady_rad[k] * moved
    return out, own


def _relative_load(t: ObservedTrial) -> Array:
    """Force on the key at the phases, of its greatest, (m,); zero where none was measured."""
    if t.force_n.size == 0:
        return np.zeros(t.time_s.size)
    force = np.interp(t.time_s, t.force_time_s, t.force_n) - t.preload_n
    return np.asarray(force / max(float(np.abs(force).max()), 1e-9))


def bend(blocks: Sequence[Block], here: Sequence[Array], there: Sequence[Array], step: Array) -> float:
    """How far the model is from its linear model after a step: root mean square, of the size of the response."""
    parts = [(t - (h - b.moved @ step)) / b.size.ravel() for b, h, t in zip(blocks, here, there, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _response_size(columns: Array, m: int) -> Array:
    """Size of the response (channels, m phases), the largest of neighbours so that no crossing of zero shows."""
    size = np.sqrt((columns**2).sum(axis=1)).reshape(-1, m)
    around = sliding_window_view(np.pad(size, ((0, 0), (SMOOTH, SMOOTH))), 2 * SMOOTH + 1, axis=1)
    return np.maximum(around.max(axis=2), FLOOR_RAD)
