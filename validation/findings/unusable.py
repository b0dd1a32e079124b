"""Trials and channels that no statement about the model may rest on: one list, for the verdict and for *What to do*."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS
from validation.findings.finding import BLOW, KINDS, PREDICTION, SessionFinding
from validation.measurement.trial import trials_in_words

FORCE, FILM, WHOLE_TRIAL = "force", "film", ""
"""What `UnusableData.channel` holds besides the names of encoders: the force of a trial, its film, all of it."""


@dataclass(frozen=True)
class UnusableData:
    """A trial, or one channel of it, that is left out."""

    trial: int
    channel: str  # ``key``, ``whippen``, ``hammer``, ``force``, ``film``, or empty for the whole trial
    kind: str  # kind of the finding that says so, of `validation.findings.finding.KINDS`
    reason: str  # the sentence of that finding

    @property
    def curves(self) -> tuple[str, ...]:
        """Channels whose curves may not be compared with a prediction: a wrong force makes the prediction wrong."""
        if self.channel == FILM:
            return FILM_CHANNELS
        return (self.channel,) if self.channel in ENCODER_CHANNELS else (*ENCODER_CHANNELS, *FILM_CHANNELS)


def list_unusable_data(findings: Iterable[SessionFinding]) -> tuple[UnusableData, ...]:
    """Every trial, or channel of one, that the findings make unusable, once, sorted by trial number; a channel is not
    listed where its whole trial is. A trial that only the model misses stays usable."""
    rows: dict[tuple[int, str], UnusableData] = {}
    for f in findings:
        spoils = KINDS[f.kind].spoils
        if not spoils or (spoils == PREDICTION and f.channel != FORCE):
            continue  # that the model misses a trial makes its data no worse
        channel = f.channel if spoils != BLOW and f.channel in (*ENCODER_CHANNELS, FORCE, FILM) else WHOLE_TRIAL
        for number in f.numbers:
            rows.setdefault((number, channel), UnusableData(number, channel, f.kind, f.text))
    whole = {number for number, channel in rows if channel == WHOLE_TRIAL}
    kept = [row for (number, channel), row in rows.items() if channel == WHOLE_TRIAL or number not in whole]
    return tuple(sorted(kept, key=lambda row: row.trial))


def list_unusable_pairs(unusable: Iterable[UnusableData]) -> frozenset[tuple[int, str]]:
    """Trials and channels, of encoders and film, whose curves may not be compared with a prediction."""
    return frozenset((row.trial, channel) for row in unusable for channel in row.curves)


def name_unusable(unusable: Sequence[UnusableData]) -> str:
    """Text such as ``trials 4, 5 (hammer: no motion), trial 7 (duplicated trial)``; empty for none."""
    by_trial: dict[int, dict[str, list[str]]] = {}
    for row in unusable:
        by_trial.setdefault(row.trial, {}).setdefault(row.kind, []).append(row.channel)
    by_words: dict[str, list[int]] = {}
    for number, kinds in by_trial.items():
        by_words.setdefault("; ".join(_name_channels(kind, channels) for kind, channels in kinds.items()), []).append(
            number
        )
    return ", ".join(f"{trials_in_words(numbers)} ({words})" for words, numbers in by_words.items())


def _name_channels(kind: str, channels: Collection[str]) -> str:
    named = [channel for channel in channels if channel]
    return f"{' and '.join(named)}: {kind}" if named else kind
