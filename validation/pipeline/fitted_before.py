"""Whether a comparison is a prediction: which of its trials the values of the model were fitted to, by their hashes."""

from __future__ import annotations

from collections.abc import Sequence

import model
from validation.measurement.trial import MeasuredTrial
from validation.prediction.posterior import Posterior, posterior_of


def fitted_trials(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[int]:
    """Numbers of the trials that the action's values were fitted to; empty for an action that was not identified."""
    posterior = posterior_of(action)
    known = set() if posterior is None else set(posterior.trials.values())
    return [m.number for m in trials if m.seal in known]


def prediction_lines(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[str]:
    """What the verdict says of an identified model: prediction or not; nothing of any other model."""
    posterior = posterior_of(action)
    if posterior is None:
        return []
    fitted = fitted_trials(action, trials)
    n = len(posterior.trials)
    if not fitted:
        return [
            f"A prediction: none of these trials is among the {n} that the values of {action.name} were fitted to "
            "(by hash)."
        ]
    which = "all of these trials" if len(fitted) == len(trials) else f"trial{'s' if fitted[1:] else ''} "
    which += "" if len(fitted) == len(trials) else ", ".join(map(str, fitted))
    return [
        f"Not a prediction: the values of {action.name} were fitted to {which} (by hash); how well they are met says "
        "nothing of other strokes."
    ]


def identified_warnings(action: model.Action) -> list[str]:
    """Warnings of the identification that an action's values come from."""
    posterior: Posterior | None = posterior_of(action)
    if posterior is None:
        return []
    said = [f"{action.name} was identified: {line}" for line in action.identification.get("warnings", [])]
    kept = {path for path in action.changed if path in posterior.moved}
    if kept:
        said.append(
            f"{action.name}: {', '.join(sorted(kept))} set by hand after the identification; the band still holds its "
            "joint uncertainty, about the values set"
        )
    return said
