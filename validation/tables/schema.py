"""The JSON Schema of ``results.json``, made from the columns of the tables and the fields described here."""

from __future__ import annotations

from typing import Any

from validation.result import OUTCOMES
from validation.tables.catalogue import all_tables

SCHEMA = "piano-action-rig results"
SCHEMA_VERSION = 8

Field = dict[str, Any]


def _field(kind: str | list[str], meaning: str, unit: str = "", **more: Any) -> Field:
    return {"type": kind, **more, "description": meaning, **({"unit": unit} if unit else {})}


def _text(meaning: str, **more: Any) -> Field:
    return _field("string", meaning, **more)


def _number(meaning: str, unit: str) -> Field:
    return _field(["number", "null"], meaning, unit)


def _map_of(meaning: str, one: Field) -> Field:
    return _field("object", meaning, additionalProperties=one)


def _list(meaning: str, kind: str = "string") -> Field:
    return _field("array", meaning, items={"type": kind})


def _record(meaning: str, fields: dict[str, Field], required: tuple[str, ...] | None = None) -> Field:
    needed = list(fields) if required is None else list(required)
    return _field("object", meaning, additionalProperties=False, required=needed, properties=fields)


SESSION = {
    "name": _text("Name"),
    "operator": _text("Who recorded it"),
    "created_utc": _text("When it was recorded"),
    "simulated": _field("boolean", "Whether on the virtual bench"),
    "rig_sha256": _text("SHA-256 of the rig file"),
    "profile": _text("Name of the motor profile"),
    "profile_sha256": _text("SHA-256 of the profile"),
}
ACTION = {
    "name": _text("Name"),
    "origin": _text("File"),
    "values_sha256": _text("SHA-256 of all values and of the structure"),
    "changed": _map_of("Parameter path → value changed after reading, SI", {"type": "number"}),
    "fitted_to": _list("Trials of this comparison that the values were fitted to (pianorig identify), by their hashes"),
}
WINDOW = {
    "start_s": _field("number", "Begin, on the DAQ clock", "s"),
    "end_s": _field("number", "End", "s"),
    "start_rule": _text("Rule of the begin"),
    "end_rule": _text("Rule of the end"),
}
JUDGEMENT = {
    "judged": _field("boolean", "Whether it was made"),
    "reason": _text("Why not"),
    "level": _field("number", "Share of models without error that it rejects", "1"),
    "rejected": _field("boolean", "Whether the test of all primary quantities and the branch shows an error"),
    "p": _number("Share of draws that reach as far in any primary quantity", "1"),
    "factor": _number(
        "Ratio of difference and scale that the largest of a model without error exceeds in 5 % of sessions", "1"
    ),
    "draws": _field("integer", "Draws of all inputs that were run", "1"),
    "failed_draws": _field("integer", "Draws that could not be run", "1"),
    "draws_on_branch": _field("integer", "Draws whose motion takes the branch of the trials", "1"),
    "branch": _text("That branch in words"),
    "branch_share": _field("number", "Share of the draws on it", "1"),
    "trials": _list("Trials judged", "integer"),
    "trials_on_other_branch": _list(
        "Trials left out of the estimates because their motion takes another branch", "integer"
    ),
    "drawn_trials": _list("Representative trials on which the inputs are drawn", "integer"),
    "log_evidence": _number(
        "Natural logarithm of the model's evidence; differences between models of a session are ln Bayes factors", "1"
    ),
    "u_log_evidence": _number("Its standard uncertainty, from the number of draws", "1"),
}
PROVENANCE = {
    "created_utc": _text("When, UTC"),
    "session": _record("The session as recorded", SESSION),
    "driven_by": _text("What drives the model: the measured force, or the measured key", enum=["force", "key"]),
    "trials_sha256": _map_of("Trial file → SHA-256 of its recorded data", {"type": "string"}),
    "action": _record("Parameter values of the model", ACTION),
    "model": _text("SHA-256 of the model's source"),
    "tolerance_rad": _field("number", "Largest error of any predicted angle that was asked for", "rad"),
    "window": _record("Evaluation window, fixed before scoring", WINDOW),
    "force": _text("How the force was corrected"),
    "alignment": _text("How model and trial share the time"),
    "event_definitions": _map_of("Event → definition", {"type": "string"}),
    "versions": _map_of("Software → version", {"type": "string"}),
    "reused": _map_of(
        "Kind of result → how many were known from earlier runs and not computed again, `4 of 5`",
        {"type": "string", "pattern": "^[0-9]+ of [0-9]+$"},
    ),
    "judgement": _record("The simultaneous test of model against trials", JUDGEMENT, ("judged",)),
    "cost": _record(
        "What a blow costs",
        {
            "right_hand_sides": _number("Mean of the trials; null for a stand-in", "1"),
            "seconds": _number("Least processor time of one, with the run that estimates its error", "s"),
        },
    ),
}
RESULT = {
    "session": _text("Name of the session"),
    "model": _text("Name of the model"),
    "outcome": _text(
        "Outcome of the verdict: an error beyond the limit of relevance, a smaller one, one of either size; agreement "
        "within the limits; or nothing can be told",
        enum=list(OUTCOMES),
    ),
    "sentence": _text("The outcome in one sentence, without the names of session and model"),
    "advice": _list("What to do, at most three sentences"),
    "verdict_lines": _list("Verdict of this session and model"),
    "warnings": _list("What a reader must know before using the numbers"),
    "provenance": _record("What the result was made from", PROVENANCE),
}
EVENT = {
    "title": _text("In words"),
    "unit": _text("Unit of its values"),
    "definition": _text("How it is found"),
}


def results_schema() -> dict[str, Any]:
    """JSON Schema (2020-12), as plain values, of ``results.json``: every field with its type, unit and meaning.

    Returns
    -------
    dict
        ``json.dumps`` writes it.

    Examples
    --------
    >>> import validation
    >>> tables = validation.results_schema()["properties"]["tables"]["properties"]
    >>> tables["scores"]["items"]["properties"]["rmse_rad"]["unit"]
    'rad'
    """
    tables = {name: table.schema for name, table in all_tables().items()}
    needed = tuple(name for name, table in all_tables().items() if table.of != "report")
    fields: dict[str, Field] = {
        "schema": {"const": SCHEMA, "description": "Name of this schema"},
        "schema_version": {
            "const": SCHEMA_VERSION,
            "description": "Version of this schema; changed when a field changes its meaning or goes",
        },
        "verdict_lines": _list("Verdict of the report, one sentence or paragraph each"),
        "refused": _list("Sessions, or sessions with a model, that could not be compared, with the reason"),
        "results": _field("array", "One for each session and model", minItems=1, items=_record("One", RESULT)),
        "tables": _record("Every table of every result, also as CSV files of these names", tables, needed),
        "event_definitions": _map_of("Event → how it is defined", _record("One event", EVENT)),
    }
    whole = _record(
        "results.json beside a validation report: sessions against models. SI units and radians; a number that does "
        "not exist is null.",
        fields,
    )
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": SCHEMA, **whole}
