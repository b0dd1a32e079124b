"""``record --plan``, ``record --resume`` and ``annotate`` as a user meets them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command_line import run


def test_a_planned_session_is_annotated_and_continued(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., None]
) -> None:
    plan, out = tmp_path / "plan.toml", tmp_path / "s"
    plan.write_text(
        'schema = "piano-action-rig plan 1"\nname = "p"\nrest_s = 600\n'
        '[[conditions]]\nname = "a"\nprofile = "forte"\n[[conditions]]\nname = "b"\nprofile = "piano"\n'
    )
    assert run("record", "--dry-run", "--plan", str(plan), "--json") == 0
    each = json.loads(capsys.readouterr().out)["conditions"]
    assert each["a"]["prediction"]["force_n"] > 1.2 * each["b"]["prediction"]["force_n"] > 0
    assert run("record", "--plan", str(plan), "--out", str(out), "--temperature", "21", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["trials"]) == 2
    assert run("annotate", str(out), "--trial", "1", "--reject", "a knock", "--author", "ana") == 0
    assert "trial 1: reject, a knock (ana)" in capsys.readouterr().out
    assert run("record", "--resume", str(out), "--json") == 0
    assert [row["trial"] for row in json.loads(capsys.readouterr().out)["trials"]] == [3]
    assert run("annotate", str(out), "--trial", "1", "--accept", "it was outside", "--json") == 0
    entries = json.loads(capsys.readouterr().out)["annotations"]
    assert [entry["kind"] for entry in entries] == ["reject", "accept"]
    for arguments, words in (
        (("annotate", str(out), "--trial", "1", "--accept", "again"), "not rejected"),
        (("annotate", str(out), "--trial", "9", "--note", "x"), "no trial 9"),
        (("annotate", str(out), "--trial", "1", "--note", " "), "no reason"),
        (("record", "--resume", str(out)), "nothing to resume"),
        (("record", "--resume", str(out), "--plan", str(plan)), "leave out --plan"),
        (("record", "--resume", str(out), "--profile", "forte"), "the session's own; leave out --profile"),
        (("record", "--plan", str(plan), "--trials", "5"), "--plan: has its own profiles and trials; leave out --tr"),
        (("record", "--dry-run", "--plan", str(plan), "--profile", "forte"), "leave out --profile"),
        (("record", "--resume", str(out), "--rig", "key_lift"), "the session's own"),
        (("record", "--resume", str(out), "--operator", "bob"), "the session's own"),
        (("record", "--resume", str(out), "--dry-run"), "rehearses --profile or --plan"),
    ):
        refused(words, *arguments)
    from rig import Session

    session = Session.open(out)
    assert session.info.room.temperature_c == 21 and session.info.room.relative_humidity_percent == "unknown"
    first, again = session.trial(1).read(), session.trial(3).read()
    assert first.condition == again.condition
    assert abs(first.raw_force_n.max() - again.raw_force_n.max()) > 1e-6  # a new blow, not the first one once more
