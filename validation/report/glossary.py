"""Words of the report for a reader who meets them first here."""

from __future__ import annotations

GLOSSARY: tuple[tuple[str, str], ...] = (
    ("trial", "one recorded blow. All trials of a session are meant to be the same blow."),
    (
        "model",
        "the simulated action. Each trial’s own measured force drives it; it is not fitted or aligned to the trials.",
    ),
    ("difference", "model minus trial, at the same instant, of the same trial."),
    (
        "u",
        "standard uncertainty: about one error in three is larger. In the heat map u is that of the mean difference: "
        "force, sensors, parameters as declared, and the scatter of the trials where it is larger.",
    ),
    (
        "allowed",
        "how many u a right model reaches somewhere, in any channel and at any time, in one session of twenty. "
        "One larger difference anywhere shows a model error.",
    ),
    ("resolved", "of an event: the difference is larger than 2 u. Each event is judged for itself."),
    ("sᵣ", "repeatability standard deviation: how much the trials differ from each other."),
    ("RMSE", "root mean square of the difference over the evaluation window."),
    ("right model", "what the RMSE of a model would be that is right within the declared uncertainties."),
    ("perfect model, ceiling", "a model that differs from the trials only by errors of force and sensors."),
    ("null model", "one moving part, nothing fitted: the least that a model of many bodies should beat."),
    ("ISO-style score", "a score from 0 to 1 in the style of ISO/TS 18571; 1 is best."),
    ("95 % band", "a band that holds the whole curve, not each instant alone, in 19 sessions of 20."),
    (
        "A, B, C",
        "positions of the thesis: at A the key reaches its bottom, at B the force is released completely, at C the key "
        "is back at its lowest point and begins to bounce.",
    ),
    ("let-off", "the jack leaves the hammer, which flies on freely."),
    ("check", "the back check catches the hammer after its rebound and holds it."),
    ("drop", "the hammer falls when the key comes up."),
    ("attack, check, hold, release, landing", "phases of a blow; each begins with the event named below the heat map."),
    ("null, dash", "a dash stands for what does not exist or cannot be stated."),
)
"""Term and meaning."""
