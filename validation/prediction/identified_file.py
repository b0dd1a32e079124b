"""Whether the file of an identified action is as it was written: hashes of its values, and of what they come from.

They find out edits, not fraud: a hash can be written anew. A file without them is taken as it is.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import model
from validation.prediction.posterior import EARLIER, TABLE, TRIALS

VALUES_SHA256, ORIGIN_SHA256 = "values_sha256", "origin_sha256"


def digests(action: model.Action, provenance: Mapping[str, Any], posterior: Mapping[str, Any]) -> dict[str, str]:
    """What the file holds beside values, trials and joint uncertainty.

    Parameters
    ----------
    action : with the values that are written
    provenance, posterior : tables of ``[identification]``
    """
    origin = json.dumps([provenance.get(TRIALS), provenance.get(EARLIER, []), posterior], sort_keys=True)
    structure = sorted((path, text) for path, text in action.structure.items() if path != "name")
    return {
        VALUES_SHA256: _sha256(f"{action.content()}\n{structure}"),
        ORIGIN_SHA256: _sha256(origin),
    }


def altered(action: model.Action) -> list[str]:
    """What was changed since the identification, in words: in the file, or by hand for this run."""
    table = action.identification
    if VALUES_SHA256 not in table or ORIGIN_SHA256 not in table:
        return [] if not action.changed else [_by_hand(action)]
    now = digests(action, table.get("provenance", {}), table.get(TABLE, {}))
    said = []
    if table[ORIGIN_SHA256] != now[ORIGIN_SHA256]:
        said.append(f"what {action.origin} says of its trials or uncertainty was edited after it was written")
    if action.changed:
        said.append(_by_hand(action))
    elif table[VALUES_SHA256] != now[VALUES_SHA256]:
        said.append(f"values in {action.origin} were edited after it was written")
    return said


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _by_hand(action: model.Action) -> str:
    return f"{', '.join(sorted(action.changed))} set by hand since"
