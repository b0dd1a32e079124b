"""Import: what was in the file is in the trial, in its own channel, unit and sense; anything doubtful is refused."""

from __future__ import annotations

import numpy as np
import pytest

from rig import InputError, Session, import_session
from rig.foreign.mapping import parse_mapping
from tests.command_line import run
from validation import TrialError
from validation.measurement.trial import measure

RATE = 4000.0
N = 1200
TIME = np.arange(N) / RATE
FORCE_V = 0.2 + 0.1 * np.clip((TIME - 0.05) / 0.1, 0, 3)
KEY = np.round(-40 * np.clip(TIME - 0.06, 0, 1) * 100)
WHIPPEN_DEG = 3.0 * np.clip(TIME - 0.06, 0, 1)
HAMMER_RAD = 0.5 * np.clip(TIME - 0.07, 0, 1)

MAPPING = """
schema = "piano-action-rig mapping 1"
simulated = false
operator = "eva"
mains_frequency_hz = 50.0
[time]
channel = "t"
[force]
channel = "load"
unit = "V"
newtons_per_unit = -25.0
zero = 0.2
group_delay_s = 1e-3
[[encoders]]
name = "key"
channel = "k"
unit = "counts"
counts_per_revolution = 327680
sign = 1
[[encoders]]
name = "whippen"
channel = "w"
unit = "deg"
counts_per_revolution = 3600000
sign = 1
[[encoders]]
name = "hammer"
channel = "h"
unit = "rad"
counts_per_revolution = 6283185
sign = -1
"""


@pytest.fixture
def recording(tmp_path):
    table = np.column_stack([TIME, 0.4 - FORCE_V, KEY, WHIPPEN_DEG, HAMMER_RAD])
    path = tmp_path / "run.csv"
    rows = "\n".join(",".join(repr(float(v)) for v in row) for row in table)
    path.write_text(f"t,load,k,w,h\n{rows}\n")
    return path


def test_every_channel_arrives_in_its_unit_and_sense(tmp_path, recording) -> None:
    session = import_session(tmp_path / "s", [recording, recording], parse_mapping(MAPPING))
    session = Session.open(session.path)
    assert [t.status for t in session.trials] == ["complete", "complete"]
    data = session.trials[1].read()
    np.testing.assert_allclose(data.raw_force_n, 25 * (FORCE_V - 0.2), atol=1e-12)
    np.testing.assert_array_equal(data.force_raw, 0.4 - FORCE_V)
    np.testing.assert_array_equal(data.encoder_count[:, 0], KEY)
    angle = data.angle_rad
    np.testing.assert_allclose(angle[:, 1], np.radians(WHIPPEN_DEG), atol=2e-6)
    np.testing.assert_allclose(angle[:, 2], -HAMMER_RAD, atol=2e-6)
    assert np.isnan(data.motor_command_v).all() and data.sample_rate_hz == pytest.approx(RATE)
    assert data.blow_start_s == pytest.approx(0.05, abs=2e-3) and data.force_info.group_delay_s == 1e-3
    assert session.info.operator == "eva" and not session.info.simulated
    assert "run.csv sha256" in session.info.notes["trial 1"] and (session.path / "mapping.toml").is_file()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('channel = "load"', 'channel = "last"', "no channel 'last'; there are t, load, k, w, h"),
        ('channel = "w"\nunit = "deg"', 'channel = "w"\nunit = "counts"', "allowed whole counts"),
        ("newtons_per_unit = -25.0\n", "", "needs it"),
        ('name = "whippen"', 'name = "key"', "in this order"),
        ("operator =", 'absent_encoders = ["key"]\noperator =', "absent_encoders names key"),
        ("operator =", 'overrule_units = ["x"]\noperator =', "overrule_units names 'x'"),
        ('channel = "h"', 'channel = "w"', "repeat"),
        ("sign = -1", "sign = 0", "sign"),
        ("simulated = false\n", "", "simulated is missing"),
        ('channel = "t"', "", "no times"),
        ('channel = "t"', 'channel = "k"', "is a measured channel as well"),
        ('channel = "t"', 'channel = "t"\nunit = "us"', "sampled at 4e+09 Hz"),
        (
            'unit = "counts"\ncounts_per_revolution = 327680',
            'unit = "rad"\ncounts_per_revolution = 327680',
            "k turns by",
        ),
        (
            '[time]\nchannel = "t"',
            "[time]\nsample_rate_hz = 5000.0",
            "t rises by 0.00025 s a sample, the stated rate means 0.0002 s",
        ),
        ("newtons_per_unit = -25.0", "newtons_per_unit = 25.0", "change the sign of force.newtons_per_unit"),
        ("operator =", "blow_start_s = 7.0\noperator =", "blow_start_s = 7 s"),
    ],
)
def test_what_does_not_fit_is_refused_and_leaves_nothing(tmp_path, recording, old, new, words) -> None:
    assert old in MAPPING
    with pytest.raises(InputError) as caught:
        import_session(tmp_path / "s", [recording], parse_mapping(MAPPING.replace(old, new, 1)))
    assert words in str(caught.value) and "\n" not in str(caught.value) and not (tmp_path / "s").exists()


def test_what_ends_an_import_half_way_leaves_nothing(tmp_path, recording, monkeypatch) -> None:
    add = Session.add_trial

    def full(session, data):
        if data.number == 2:
            raise InputError("disk full")
        return add(session, data)

    monkeypatch.setattr(Session, "add_trial", full)
    with pytest.raises(InputError, match="disk full"):
        import_session(tmp_path / "s", [recording] * 3, parse_mapping(MAPPING))
    assert not (tmp_path / "s").exists()
    with pytest.raises(InputError, match="character NUL"):
        parse_mapping(MAPPING.replace('operator = "', 'operator = "a\\u0000'))


PARTIAL = MAPPING[: MAPPING.index('[[encoders]]\nname = "whippen"')]


def test_encoders_that_were_not_there_are_absent_and_named(tmp_path, recording, capsys) -> None:
    """Missing is missing, not zero: each reader names it in one line."""
    with pytest.raises(InputError, match=r"encoders: whippen is missing; add it, or say absent_encoders"):
        parse_mapping(PARTIAL)
    session = tmp_path / "s"
    (tmp_path / "m.toml").write_text(PARTIAL.replace("[time]", 'absent_encoders = ["whippen", "hammer"]\n[time]'))
    for arguments, words in (
        (["import", recording, "--mapping", tmp_path / "m.toml", "--out", session], "trial 1: run.csv"),
        (["info", session], "not_recorded whippen, hammer"),
        (["watch", session, "--once"], "not recorded: whippen, hammer"),
        (["watch", session, "--once", "--png", tmp_path / "w.png"], "complete"),
    ):
        assert run(*arguments) == 0 and words in capsys.readouterr().out
    data = Session.open(session).trials[0].read()
    assert data.encoder_count.shape == (N, 1) and data.absent == ("whippen", "hammer")
    assert list(data.to_frame().columns)[-2:] == ["key_count", "key_rad"]
    with pytest.raises(TrialError, match="encoder 'whippen' is missing; found \\['key'\\]"):
        measure(data, None, None)
    assert Session.open(session).info.notes["absent encoders"] == "whippen, hammer"


def test_the_corrected_force_of_an_export_is_not_corrected_again(tmp_path, recording) -> None:
    """Of an exported trial ``raw_force_n`` is imported; of another program's file ``force_n`` may be the reading."""
    rows = recording.read_text().splitlines()
    named = MAPPING.replace('channel = "load"', 'channel = "force_n"')
    for head, refused in (("t,force_n,k,w,h", False), ("t,force_n,k,w,h,raw_force_n", True)):
        file = tmp_path / "export.csv"
        file.write_text("\n".join([head, *(row + (",0.0" if refused else "") for row in rows[1:])]))
        if refused:
            with pytest.raises(InputError, match=r"export\.csv: force_n .* corrected already; import raw_force_n"):
                import_session(tmp_path / "again", [file], parse_mapping(named))
            assert not (tmp_path / "again").exists()
        else:
            data = import_session(tmp_path / "other", [file], parse_mapping(named))[1].read()
            np.testing.assert_allclose(data.raw_force_n, 25 * (FORCE_V - 0.2), atol=1e-12)
