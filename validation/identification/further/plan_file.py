"""What to record next as a trial plan that ``record --plan`` plays, with the profile it names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rig import load_plan
from rig.configuration.profile import built_in_profiles
from validation.errors import ValidationInputError
from validation.identification.further.shrink import Prospect
from validation.identification.outcome.target_file import check_target
from validation.report.files import write_files

SHOWN = 8


def best_stroke(ranked: Sequence[Prospect]) -> Prospect | None:
    """The best of those that are strokes of a profile; None where the bench allows or the model predicts none."""
    strokes = (p for p in ranked if p.candidate is not None and p.candidate.profile is not None)
    return next(strokes, None)


def write_plan(ranked: Sequence[Prospect], path: str | Path, doubts: Sequence[str] = ()) -> dict[str, Path]:
    """Write the best stroke as a plan, beside it its profile, whole or not at all.

    Parameters
    ----------
    ranked : what `validation.identification.further.shrink.prospects` found
    path : plan file to write, ending in .toml
    doubts : why the numbers may not come true; said in the file

    Returns
    -------
    dict
        Relative name -> path of what was written.

    Raises
    ------
    ValidationInputError
        Another ending, a folder that is not there, or nothing to recommend.
    """
    target = check_target(path)
    best = best_stroke(ranked)
    profile = None if best is None or best.candidate is None else best.candidate.profile
    if best is None or profile is None:
        raise ValidationInputError(f"{target}: no profile can be recommended, so that there is no plan to write")
    condition = re.sub(r"[^A-Za-z0-9.-]+", "_", profile.name).strip("_.-")
    built_in = profile.name in built_in_profiles()
    named = profile.name if built_in else f"{target.stem}_{condition}.toml"
    limits = {name: best.range(name) for name in best.shrink}
    lines = [
        "# What to record next, by pianorig identify: u of each parameter after, divided by u now, as predicted at the",
        "# identified values, and 95 % limits: the strokes teach about the noise, too.",
        *(f"# In doubt: {line}." for line in doubts),
        *(f"# {name}: {x:.2f} ({limits[name][0]:.2f} to {limits[name][1]:.2f})" for name, x in best.shrink.items()),
        "#",
        "# What else was looked at, geometric mean of the same:",
        *(f"# {p.mean:.2f}  {p.name}" for p in ranked[:SHOWN]),
        'schema = "piano-action-rig plan 1"',
        f'name = "record next: {profile.name}"',
        'order = "listed"',
        "[[conditions]]",
        f'name = "{condition}"',
        f'profile = "{named}"',
        f"repeats = {best.trials}",
    ]
    texts: dict[str, str | bytes] = {} if built_in else {named: profile.text}
    texts[target.name] = "\n".join(lines) + "\n"
    written = write_files(target.parent, texts)
    load_plan(target)  # what was written can be played
    return written
