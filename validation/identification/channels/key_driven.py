"""Trials that the measured motion of the key drives: no force was recorded, or it is not to be used.

Conventions: whippen and hammer (and a film's bodies) are compared, at phases as in `observations`, from just before the
key moves until it goes up again. The key's motion is a differentiable curve fitted to its encoder, since rest; the
model adds its own rest angle under the arm's preload. Errors of the key's encoder are errors of what drives: they move
like parameters, in the trials that a force drives, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model.errors import ModelError
from model.motion_driven.spline_fit import fit_key_motion
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.identification.observations import (
    LEAD_S,
    PHASES,
    ObservedTrial,
    Span,
    common_phases,
    encoder_noise,
    sampled,
    with_film,
)
from validation.identification.unknowns.priors import FORCE, KEY, Parameter, Unknowns
from validation.measurement.trial import MeasuredTrial

MOVES, DOWN = 0.01, 0.5  # of the key's largest turn: from where on it moves; below it for good, it goes up
AFTER_S = 2e-3
WITHOUT_KEY = (1, 2)


def observe_driven(
    name: str, session: int, trials: Sequence[MeasuredTrial], phases: int = PHASES, film: bool = False
) -> list[ObservedTrial]:
    """Thin the trials of one session to common phases, each driven by its own key; as `observations.observe`.

    Raises
    ------
    ValidationInputError
        The trials have no span in common, or a key's angles are no motion.
    """
    spans = [_span(m) for m in trials]
    at = common_phases(name, trials, spans, phases)
    seen = [_observed(name, session, m, s, at) for m, s in zip(trials, spans, strict=True)]
    return [with_film(t, m) for t, m in zip(seen, trials, strict=True)] if film else seen


def _span(m: MeasuredTrial) -> Span:
    key, hammer = (np.abs(m.change_rad[:, c]) for c in (0, 2))
    moves = int(np.argmax(key > MOVES * key.max()))
    top = float(m.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))])
    down = np.flatnonzero(key > DOWN * key.max())
    return Span(max(float(m.time_s[moves]) - 2e-3, float(m.time_s[0]) + LEAD_S), top, float(m.time_s[down[-1]]))


def _observed(name: str, session: int, m: MeasuredTrial, span: Span, phases: Array) -> ObservedTrial:
    index = sampled(m, span, phases)
    time = m.time_s[index]
    inside = (m.time_s > span.start_s - LEAD_S) & (m.time_s <= time[-1] + AFTER_S)
    try:
        key = fit_key_motion(m.time_s[inside], m.change_rad[inside, 0], resolution_rad=float(m.resolution_rad[0]))
    except ModelError as error:
        raise ValidationInputError(f"{name}, trial {m.number}: {error}") from None
    white, steady = encoder_noise(m)
    measured = list(WITHOUT_KEY)
    scale = np.asarray(m.scale_relative_u, dtype=float)
    force = m.force.channel
    return ObservedTrial(
        label=f"{name}, trial {m.number}",
        session=session,
        number=m.number,
        force_time_s=np.empty(0),
        force_n=np.empty(0),
        time_s=time,
        change_rad=m.change_rad[index][:, measured],
        u_white_rad=np.hypot(white, white)[measured],
        u_steady_rad=steady[measured],
        u_scale=scale[measured],
        preload_n=force.preload_n,
        u_preload_n=force.u_preload_n,
        u_offset_n=0.0,
        u_gain=0.0,
        u_delay_s=0.0,
        noise_n=0.0,
        channels=WITHOUT_KEY,
        key=key,
        u_key_rad=float(steady[0]),
        u_key_scale=float(scale[0]),
        key_moves=True,
    )


def sharing_the_key(trials: Sequence[ObservedTrial]) -> list[ObservedTrial]:
    """All trials, with errors of the key's encoder that move where they move in any of them."""
    if all(t.key is None for t in trials):
        return list(trials)
    return [
        t
        if t.key is not None
        else replace(t, key_moves=True, u_key_rad=float(t.u_steady_rad[0]), u_key_scale=float(t.u_scale[0]))
        for t in trials
    ]


def with_errors_of_what_drives(asked: Unknowns, trials: Sequence[ObservedTrial]) -> Unknowns:
    """The unknowns with errors of the force, of the key's encoder, or of both, as the trials are driven."""
    errors: tuple[Parameter, ...] = ()
    if any(t.key is None for t in trials):
        errors += FORCE
    if any(t.key is not None for t in trials):
        errors += KEY
    return replace(asked, force=errors)
