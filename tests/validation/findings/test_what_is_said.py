"""Sessions whose report said something false: no sentence of theirs names a cause, and what is said is what is so."""

from __future__ import annotations

import pytest

from benchmarks.what_is_said import CAUSES, cases, sentences

SAID = {
    "1 shank_called_regulation": (),
    "2 string_called_scale": ("encoder hammer: in all 6 trials it travels 1.05",),
    "3 shank_and_gain": (),
    "4a frozen_key": ("trial 2: encoder key: its count does not change for 29.8 ms from 0.2900 s",),
    "4c frozen_whippen_filmed": ("trial 2: encoder whippen: its count does not change for 29.8 ms",),
    "5 let_off_from_4": ("encoder whippen: from trial 4 on (3 of 6 trials)", "from trial 4 on the difference"),
    "6 delay_drift": ("from trial 3 on (4 of 6 trials)", "2.4 ms more in trial 6"),
    "7 key_down_at_start": ("trial 4: the record does not begin at rest",),
    "9 three_kinds": ("3 kinds of stroke: trials 1, 2",),
    "11 one_millisecond": ("in all 4 trials it lags the key's acceleration by 1.0 ms less than in the model",),
    "12 before_let_off": (),
}


@pytest.mark.parametrize("name", SAID)
def test_what_is_said_of_a_session_is_so(name):
    case = cases()[name]
    said = sentences(name, case.stroke or "mf", 1, False, False)
    text = "\n".join(line for lines in said.values() for line in lines)
    assert not [word for word in (*CAUSES, *case.never) if word in text]
    findings = "\n".join(said["finding"])
    assert all(words in findings for words in SAID[name]), findings
    assert bool(findings) == bool(SAID[name])
