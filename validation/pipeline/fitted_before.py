"""Whether a comparison is a prediction: which of its trials the values of the model were fitted to, by their hashes."""

from __future__ import annotations

from collections.abc import Sequence

import model
from validation.measurement.trial import MeasuredTrial
from validation.prediction.identified_file import altered
from validation.prediction.posterior import UNKNOWN_STROKE, posterior_of


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
    doubts = altered(action)
    if not fitted:
        if any(seal.startswith(UNKNOWN_STROKE) for seal in posterior.trials.values()):
            doubts.append("they were fitted to tables that do not say which recorded strokes they hold")
        none = f"none of these trials is among the {n} that the values of {action.name} were fitted to (by hash)"
        if doubts:
            return [f"Whether this is a prediction is not known: {none}, but {'; '.join(doubts)}."]
        return [f"A prediction: {none}."]
    aside = [m.number for m in trials if m.number not in fitted]
    which = _trials(fitted) if aside else "all of these trials"
    if aside and doubts:  # what the file says of the others may be wrong
        return [f"Not a prediction: the values of {action.name} were fitted to {which} (by hash); {'; '.join(doubts)}."]
    kept = f"; {_trials(aside)} {'was' if len(aside) == 1 else 'were'} not fitted" if aside else ""
    return [
        f"Not a prediction: the values of {action.name} were fitted to {which} (by hash){kept}; how well fitted trials "
        "are met says nothing of other strokes."
    ]


def _trials(numbers: Sequence[int]) -> str:
    return f"trial{'' if len(numbers) == 1 else 's'} {', '.join(map(str, numbers))}"


def identified_warnings(action: model.Action) -> list[str]:
    """Warnings of the identification that an action's values come from."""
    if posterior_of(action) is None:
        return []
    said = [f"{action.name} was identified: {line}" for line in action.identification.get("warnings", [])]
    changed = "; the band still holds its joint uncertainty, about the values now"
    return said + [f"{action.name}: {line}{changed}" for line in altered(action)]
