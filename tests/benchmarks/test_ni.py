"""The runner of NI's examples: a program as it stands runs on the virtual device, and what stops it is told apart."""

from __future__ import annotations

from pathlib import Path

from benchmarks.ni import NO_SIGNAL, OTHER_DEVICE, RAN, REFUSED, Outcome, _outcome, run_programs, table

PROGRAM = """
import nidaqmx
with nidaqmx.Task() as task:
    task.ai_channels.add_ai_voltage_chan("{channel}")
    input("Press Enter")
    print(task.read())
"""


def test_a_program_for_this_card_runs_and_one_for_another_does_not(tmp_path: Path) -> None:
    (tmp_path / "card.py").write_text(PROGRAM.format(channel="Dev1/ai0"), encoding="utf-8")
    (tmp_path / "other.py").write_text(PROGRAM.format(channel="PXI1Slot2/ai0"), encoding="utf-8")
    found = run_programs(tmp_path)
    assert [(outcome.name, outcome.result) for outcome in found] == [("card.py", RAN), ("other.py", OTHER_DEVICE)]
    assert "| ran | 1 |" in table(found) and "| `other.py` | another device | -200220" in table(found)


def test_what_ends_a_program_is_told_apart() -> None:
    def said(text: str, code: int = 1, interrupted: bool = False) -> Outcome:
        return _outcome("x.py", code, text, interrupted)

    assert said("done", code=0).result == RAN
    assert said("Traceback\nKeyboardInterrupt", interrupted=True).result == NO_SIGNAL
    assert said("nidaqmx.errors.DaqReadError: none\nStatus Code: -200284").result == NO_SIGNAL
    assert said("nidaqmx.errors.DaqError: refused\nStatus Code: -200452").result == REFUSED
