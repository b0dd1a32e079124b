"""The action file of an identification: values with their uncertainties, and how they were found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import model
from model.parameters.action import action_text
from validation.infer.estimates import IDENTIFIED
from validation.measurement.position_sensors import TABLE as SENSORS
from validation.prediction.posterior import TABLE, TRIALS, digests


def identified_text(found: Any) -> str:
    """TOML text of the action file of an `Identification` ``found``: the identified values, and a table
    ``[identification]`` with intervals, scores and hashes of the data; nothing is written.

    A valid action file: every command takes it with ``--action``. Its table ``[identification]`` holds the asked
    parameters with intervals and correlations, what the strokes cannot tell, the scores, the hashes of the data, and
    the joint uncertainty that a comparison draws from (`validation.prediction.posterior`); the model does not read it.
    """
    head = [f"identified {found.provenance['created_utc']} from {len(found.provenance[TRIALS])} trials"]
    head += [f"WARNING: {line}" for line in found.warnings]
    action = _set_posterior_u(found)
    hashes = digests(action, found.provenance, found.posterior.table())
    return action_text(action, head) + "\n" + "\n".join(_table(found, hashes)) + "\n"


def _set_posterior_u(found: Any) -> model.Action:
    """Copy of an `Identification`'s action, named ``…-identified``: quantities asked for have their posterior u and the
    verdict as source, the others that the fit moved a source that says so."""
    quantities = {**found.action.quantities, **found.action.effects}
    for path in found.action.changed:
        quantities[path] = replace(quantities[path], source="fitted beside what was identified; not a finding")
    for e in found.estimates:
        for path in found.provenance["paths"][e.name]:
            q = quantities[path]
            relative = e.u / abs(e.value) if e.value else math.inf
            u = e.u if len(found.provenance["paths"][e.name]) == 1 else relative * abs(q.value)
            said = "identified" if e.verdict == IDENTIFIED else f"fitted; {e.verdict}"
            quantities[path] = replace(q, u=float(u), basis="measured", source=f"{said}; see [identification]")
    own = {path: quantities.pop(path) for path in found.action.effects}
    return replace(found.action, name=f"{found.action.name}-identified", quantities=quantities, effects=own, changed={})


def _table(found: Any, hashes: Mapping[str, str]) -> list[str]:
    """Lines of the TOML section ``[identification]`` of an `Identification`: estimates, correlation, warnings,
    provenance, scores, events, posterior; ``hashes``: key -> SHA-256, written as they are."""
    names = [e.name for e in found.estimates]
    lines = ["[identification]", f"names = {_value(names)}", f"correlation = {_value(found.correlation.tolist())}"]
    lines.append(f"warnings = {_value(list(found.warnings))}")
    lines.append(f"undetermined = {_value([d.words for d in found.undetermined])}")
    lines += [f"{k} = {_value(v)}" for k, v in hashes.items()]
    lines += ["", "[identification.provenance]"]
    lines += [f"{_key(k)} = {_value(v)}" for k, v in found.provenance.items()]
    lines += ["", "[identification.scores]"]
    lines += [f"{_key(k)} = {_value(v)}" for k, v in found.scores.items()]
    lines += ["", "[identification.events]"]
    for name, by in found.events.items():
        plain = {who: {event: asdict(score) for event, score in of.items()} for who, of in by.items()}
        lines.append(f"{_key(name)} = {_value(plain)}")
    lines += ["", f"[identification.{TABLE}]"]
    lines += [f"{k} = {_value(v)}" for k, v in found.posterior.table().items()]
    if found.sensors is not None:
        lines += ["", f"[identification.{SENSORS}]"]
        lines += [f"{k} = {_value(v)}" for k, v in found.sensors.table().items()]
    for e in found.estimates:
        lines += ["", f"[identification.parameters.{_key(e.name)}]"]
        lines += [f"{k} = {_value(v)}" for k, v in asdict(e).items() if k != "name"]
    return lines


def _key(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _value(value: Any) -> str:
    """TOML text of a plain value (text, number, bool, list, mapping); an entry of a mapping that is None is left out,
    and anything else becomes a quoted string."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)  # inf and nan are TOML, too
    return _key(str(value))
