"""Damaged text of every reader: an error of one line or the right values, never a traceback, a hang or a wrong number.

What "right" means is told by a second, independent reading of the same bytes.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rig.fuzz import recording_cases, settings_cases
from tests.rig.fuzz.damage import COUNTS, survive

CASES = {
    "rig": settings_cases.rig_case,
    "profile": settings_cases.profile_case,
    "plan": settings_cases.plan_case,
    "mapping": settings_cases.mapping_case,
    "film record": settings_cases.film_case,
    "self-test record": settings_cases.selftest_case,
    "bodies": settings_cases.bodies_case,
    "camera": settings_cases.camera_case,
    "csv": recording_cases.csv_case,
    "european csv": recording_cases.european_csv_case,
    "lvm": recording_cases.lvm_case,
    "lvm segments": recording_cases.segments_case,
}


@pytest.mark.parametrize("inputs", COUNTS)
@pytest.mark.parametrize("name", CASES)
def test_text_is_read_right_or_refused(name: str, inputs: int, tmp_path: Path) -> None:
    whole, read, check = CASES[name](tmp_path)
    refused = survive(whole, read, check, inputs)
    assert 0 < refused < inputs  # the damage neither spares nor spoils everything
