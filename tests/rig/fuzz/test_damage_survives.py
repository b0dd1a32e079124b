"""Damaged text and recordings: an error of one line or the right values, never a traceback, a hang or a wrong number.

What "right" means is told by a second, independent reading of the same bytes.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rig.fuzz import recording_cases, settings_cases, stored_cases
from tests.rig.fuzz.damage import INPUTS, survive

TEXTS = {
    "rig": settings_cases.rig_case,
    "profile": settings_cases.profile_case,
    "plan": settings_cases.plan_case,
    "mapping": settings_cases.mapping_case,
    "bodies": settings_cases.bodies_case,
    "camera": settings_cases.camera_case,
    "csv": recording_cases.csv_case,
    "european csv": recording_cases.european_csv_case,
    "lvm segments": recording_cases.segments_case,
    "csv of a logger": recording_cases.logger_csv_case,
}
BINARY = {
    "tdms": stored_cases.tdms_case,
    "big-endian tdms": stored_cases.big_endian_tdms_case,
    "plain hdf5": stored_cases.hdf5_case,
    "session": stored_cases.session_case,
    "annotations": stored_cases.annotations_case,
    "trial": stored_cases.trial_case,
    "journal": stored_cases.journal_case,
}
LEAST_REFUSED = {"tdms": 1 / 3, "big-endian tdms": 1 / 3, "trial": 0.9}
"""Part of the damaged inputs that must be refused; the journal is read as far as it is whole."""


@pytest.mark.parametrize("name", [*TEXTS, *BINARY])
def test_damaged_input_is_read_right_or_refused(name: str, tmp_path: Path) -> None:
    whole, read, check = {**TEXTS, **BINARY}[name](tmp_path)
    inputs = INPUTS // 8 if name == "trial" else INPUTS  # each is hashed as a whole
    refused = survive(whole, read, check, inputs)
    if name in TEXTS:
        assert 0 < refused < inputs  # the damage neither spares nor spoils everything
    else:
        assert refused == 0 if name == "journal" else refused > LEAST_REFUSED.get(name, 0) * inputs
