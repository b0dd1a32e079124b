"""On hardware nothing moves without a typed name or a permitted --yes, a self-test that passed, and a dry run."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from pianorig.console import terminal as asking
from rig import (
    Capabilities,
    InputError,
    LimitExceeded,
    NotPermitted,
    Permission,
    PredictedBlow,
    SelftestFinding,
    SelftestRecord,
    Session,
    permit,
)
from rig.safety.permission import confirm, require_permission
from rig.selftest import read_record, valid_record

NOW = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
CARD = Capabilities("a chassis", False, {"product": "cDAQ-9189", "serial_number": "01AB"}, hardware=True)


def record_of(rig, *, hours_ago: float = 1.0, passed: bool = True, **changes) -> SelftestRecord:
    fields = {
        "created_utc": NOW - timedelta(hours=hours_ago),
        "rig": rig.config.name,
        "rig_sha256": rig.sha256,
        "product": "cDAQ-9189",
        "device": "cDAQ1",
        "serial_number": "01AB",
        "backend": "test",
        "simulated": False,
        "findings": (SelftestFinding(check="drive", passed=passed, found="1", allowed="1"),),
        **changes,
    }
    return SelftestRecord(**fields)


def never(question: str) -> str | None:
    raise AssertionError("asked")


def test_the_name_must_be_typed_or_yes_permitted_by_the_rig_file(rig, edited_rig) -> None:
    questions = []

    def typing(answer):
        def ask(question: str) -> str | None:
            questions.append(question)
            return answer

        return ask

    assert confirm(rig, "ni://local", yes=False, ask=typing(" virtual ")) == "typed"
    assert "ni://local" in questions[0] and "virtual" in questions[0]
    for answer, said in (("yes", "typed 'yes', expected 'virtual'"), ("", "typed ''"), (None, "nobody to confirm")):
        with pytest.raises(NotPermitted, match=said):
            confirm(rig, "ni://local", yes=False, ask=typing(answer))
    with pytest.raises(NotPermitted, match="`yes` is not permitted"):
        confirm(rig, "ni://local", yes=True, ask=never)
    open_rig = edited_rig(("allow_yes = false", "allow_yes = true"))
    assert confirm(open_rig, "ni://local", yes=True, ask=never) == "--yes"


def test_the_newest_record_of_this_rig_file_counts_and_must_have_passed_lately(rig, edited_rig, tmp_path) -> None:
    with pytest.raises(NotPermitted, match="no self-test of rig file"):
        valid_record(rig, tmp_path, NOW)
    record_of(rig, hours_ago=30).write(tmp_path)
    with pytest.raises(NotPermitted, match="30.0 h old, allowed 0 to 24 h"):
        valid_record(rig, tmp_path, NOW)
    good = record_of(rig, hours_ago=3, unloaded_n=0.152)
    path = good.write(tmp_path)
    assert valid_record(rig, tmp_path, NOW) == (path, good) and read_record(path) == good
    assert valid_record(rig, path, NOW)[1] == good
    other = edited_rig(("preload_n = 0.05", "preload_n = 0.06"))
    with pytest.raises(NotPermitted, match="no self-test of rig file"):
        valid_record(other, tmp_path, NOW)
    record_of(rig, hours_ago=2, passed=False).write(tmp_path)
    with pytest.raises(NotPermitted, match=r"did not pass \(drive\)"):
        valid_record(rig, tmp_path, NOW)
    record_of(rig, hours_ago=-1).write(tmp_path)  # a clock that was set back
    with pytest.raises(NotPermitted, match="-1.0 h old"):
        valid_record(rig, tmp_path, NOW)
    (tmp_path / "z.toml").write_text("passed = true")
    with pytest.raises(InputError, match="z.toml"):
        valid_record(rig, tmp_path, NOW)


def test_the_self_test_is_looked_for_before_anybody_is_asked(rig, tmp_path) -> None:
    with pytest.raises(NotPermitted, match="no self-test.* selftest --backend ni://local --rig"):
        permit(rig, "ni://local", tmp_path, yes=False, ask=never, now=NOW)


def test_what_is_missing_is_named_and_the_virtual_bench_needs_nothing(rig, edited_rig) -> None:
    whole = Permission("typed", rig.sha256, record_of(rig))
    require_permission(rig, CARD, whole, True)
    require_permission(rig, Capabilities("virtual bench", True, {}), None, False)
    for permission, dry_run, said in (
        (None, True, "needs a permission"),
        (Permission("typed", "0" * 64, record_of(rig)), True, "for another rig file"),
        (Permission("typed", rig.sha256, None), True, "needs a self-test that passed"),
        (Permission("typed", rig.sha256, record_of(rig, passed=False)), True, "needs a self-test that passed"),
        (
            Permission("typed", rig.sha256, record_of(rig, product="PCIe-6363")),
            True,
            "is a cDAQ-9189, serial number 01AB; the self-test was made on a PCIe-6363, serial number 01AB",
        ),
        (Permission("typed", rig.sha256, record_of(rig, serial_number="02CD")), True, "serial number 02CD; run"),
        (Permission("typed", rig.sha256, record_of(rig, simulated=True)), True, "made on a simulated cDAQ-9189"),
        (whole, False, "needs a dry run"),
    ):
        with pytest.raises(NotPermitted, match=said) as refusal:
            require_permission(rig, CARD, permission, dry_run)
        assert refusal.value.exit_code == 3


def hardware(backend, monkeypatch):
    """Have a virtual bench say that it is a real one."""
    monkeypatch.setattr(type(backend), "capabilities", CARD)
    return backend


def test_without_permission_not_one_call_reaches_the_hardware(
    rig, make_backend, record_steps, tmp_path, monkeypatch
) -> None:
    backend = hardware(make_backend(rig.config), monkeypatch)
    with pytest.raises(NotPermitted):
        record_steps(rig, backend=backend)
    assert backend.service.trace == [] and not (tmp_path / "s").exists()


@pytest.mark.parametrize(("unloaded_n", "seen"), [(0.0, True), (0.05, False)])
def test_with_the_unloaded_reading_known_the_arm_must_press_on_the_key(
    unloaded_n, seen, rig, make_backend, record_steps, tmp_path, monkeypatch
) -> None:
    backend = hardware(make_backend(rig.config, noise_n=0.02), monkeypatch)
    permission = Permission("typed", rig.sha256, record_of(rig, unloaded_n=unloaded_n))
    n = 10

    def predict(profile):
        return PredictedBlow(np.arange(n) / 5000, np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)), "nothing moves")

    asked = {"backend": backend, "permission": permission, "predict": predict}
    if seen:
        session = record_steps(rig, **asked)
        assert session.trials[0].status == "complete"
        assert session.info.notes["permission"] == "typed" and "drive: 1" in session.info.notes["selftest"]
        return
    with pytest.raises(LimitExceeded, match="the arm is not on the key"):
        record_steps(rig, **asked)
    data = Session.open(tmp_path / "s").trial(1).read()
    assert data.status == "fault" and not data.motor_command_v.any()


def test_where_there_is_no_terminal_nobody_answers(monkeypatch, capsys) -> None:
    read, write = os.pipe()
    os.close(write)
    with os.fdopen(read) as stream:
        monkeypatch.setattr("sys.stdin", stream)
        assert asking.type_answer("may it move? ") is None
    assert capsys.readouterr().err == ""
