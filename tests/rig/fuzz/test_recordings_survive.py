"""Damaged recordings of every kind: an error of one line or the right values, never a traceback or a wrong number."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rig.fuzz import stored_cases
from tests.rig.fuzz.damage import COUNTS, survive

CASES = {
    "tdms": stored_cases.tdms_case,
    "big-endian tdms": stored_cases.big_endian_tdms_case,
    "session": stored_cases.session_case,
    "annotations": stored_cases.annotations_case,
    "trial": stored_cases.trial_case,
    "journal": stored_cases.journal_case,
}
LEAST_REFUSED = {"tdms": 1 / 3, "big-endian tdms": 1 / 3, "trial": 0.9}
"""Part of the damaged inputs that must be refused; the journal is read as far as it is whole."""


@pytest.mark.parametrize("inputs", COUNTS)
@pytest.mark.parametrize("name", CASES)
def test_a_recording_is_read_right_or_refused(name: str, inputs: int, tmp_path: Path) -> None:
    whole, read, check = CASES[name](tmp_path)
    inputs = inputs // 10 if name == "trial" else inputs  # each is hashed as a whole
    refused = survive(whole, read, check, inputs)
    assert refused == 0 if name == "journal" else refused > LEAST_REFUSED.get(name, 0) * inputs
