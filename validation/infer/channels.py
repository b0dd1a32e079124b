"""Errors of a session's channels: names, priors, and what an encoder reads with one.

Conventions: an error is what is wrong with a channel. A force gain of 0.9 reads 0.9 of the force that acted beside the
preload, which is declared and not read; a level of 0.1 N is a preload declared 0.1 N too large; a delay is how late a
channel reads. A zero error of an encoder is a wrong reading at rest: it shows once its body has moved. An encoder that
slips, or whose counter wraps, leaps: the findings see that, and the reading is not compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.prediction.joint_draws import MOVED_RAD

FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY = "force gain", "force level", "force delay"
CLOCK = "clock rate"
KEY_SCALE, KEY_ZERO = "key encoder scale", "key encoder zero"
SCALE, ZERO, DELAY = "encoder scale", "encoder zero", "encoder delay"


@dataclass(frozen=True)
class ChannelError:
    """One error of a channel."""

    name: str
    unit: str  # SI unit of what is added; 1 means a factor
    wrong: float  # how large it is where the channel is not as declared, as a logarithm where ``unit`` is 1
    kind: str = ""  # of an encoder: `SCALE`, `ZERO` or `DELAY`; empty for force and clock
    encoder: int = -1  # place of the encoder; -1 for force and clock

    def reading(self, turned: Array, size: float) -> Array:
        """What the encoder reads (m,) of a turn since rest, with a size of this error; a delay is run."""
        return turned * size if self.kind == SCALE else turned + size * error_shape(self.kind, turned)


def error_shape(kind: str, turned: Array) -> Array:
    """Derivative (m,) of an encoder's reading of a turn (m,) since rest, rad, by its `SCALE` or `ZERO` (rad)."""
    return turned if kind == SCALE else np.asarray(-np.expm1(-np.abs(turned) / MOVED_RAD))


def _encoder_errors(name: str, encoder: int) -> tuple[ChannelError, ...]:
    """Errors of one encoder: 5 % of its scale, 1 ms, and 1 mrad, a sixtieth of what a key turns."""
    return (
        ChannelError(f"{name} {SCALE}", "1", 0.05, SCALE, encoder),  # choice: pulses miscounted or a loose disc
        ChannelError(f"{name} {DELAY}", "s", 1e-3, DELAY, encoder),
        ChannelError(f"{name} {ZERO}", "rad", 1e-3, ZERO, encoder),
    )


CHANNEL_ERRORS = (
    ChannelError(FORCE_GAIN, "1", 0.05),
    ChannelError(FORCE_LEVEL, "N", 0.1),
    ChannelError(FORCE_DELAY, "s", 1e-3),
    ChannelError(CLOCK, "1", 0.01),
    *(error for i, name in enumerate(ENCODER_CHANNELS) for error in _encoder_errors(name, i)),
)
"""All errors that a search compares: 5 % of the force, 0.1 N, 1 ms, 1 % of the clock's rate, and those of the encoders.
From trial to trial only the force's offset scatters, as its trial declares it (`ObservedTrial.u_offset_n`)."""
ERROR_BY_NAME = {error.name: error for error in CHANNEL_ERRORS}
