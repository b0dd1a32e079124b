"""What the page answers over HTTP, without a browser: rights, the table from files alone, hostile folders."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from urllib.parse import quote

import pytest

from rig import Session
from tests.pianorig.page.conftest import Page, heard

ANNOTATIONS = "/api/sessions/example_forte/annotations"
NOTE = {"trial": 2, "kind": "reject", "reason": "cable <b>touched</b>", "author": "ana"}


def test_only_the_loopback_is_listened_on(looking: Page) -> None:
    addresses = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), looking.port, socket.AF_INET)}
    for address in addresses - {"127.0.0.1"}:
        with socket.socket() as other:
            other.settimeout(5)
            assert other.connect_ex((str(address), looking.port)) != 0
    assert looking.ask("/").status == 200


def test_every_answer_is_guarded(looking: Page) -> None:
    for path in ("/", "/web/bench.js", "/drawing/bokeh.min.js", "/api/about", "/api/sessions", "/nothing"):
        refused = looking.ask(path, Host="evil.example")
        assert refused.status == 403 and "evil.example" in refused.json["error"], path
        answer = looking.ask(path)
        assert answer.status == (404 if path == "/nothing" else 200), path
        for found in (refused, answer):
            policy = found.headers["Content-Security-Policy"]
            assert "default-src 'none'" in policy and "unsafe-eval" not in policy
            assert found.headers["X-Content-Type-Options"] == "nosniff"
            assert found.headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert "Access-Control-Allow-Origin" not in found.headers
    here = f"127.0.0.1:{looking.port}"
    for host in (None, "127.0.0.1", "127.0.0.1:9", f"evil.example:{looking.port}", f"{here}.evil.example"):  # rebinding
        assert looking.ask("/api/sessions", Host=host).status in (400, 403), host
    assert looking.ask("/api/sessions", Host=f"LOCALHOST:{looking.port}", Sec_Fetch_Site="same-origin").status == 200
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9", f"https://{here}"):
        assert looking.ask("/api/sessions", Origin=origin).status == 403, origin
    linked = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate"}
    assert looking.ask("/", **linked).status == 200  # a link to the page
    assert looking.ask("/api/sessions", Sec_Fetch_Site="cross-site").status == 403
    assert looking.ask("/api/sessions", method="PUT").status == 405


def writes() -> list[tuple[str, str]]:
    """Method and address of all that changes anything."""
    from pianorig.page.answers import ADDRESSES, NAME, NUMBER

    found = {address.replace(NAME, "example_forte").replace(NUMBER, "1"): does for address, does in ADDRESSES.items()}
    return [(method.upper(), address) for address, does in found.items() for method in does if method != "get"]


def contents(folder: Path) -> list[tuple[Path, bytes]]:
    return sorted((path, path.read_bytes()) for path in folder.rglob("*") if path.is_file())


def test_without_control_the_page_only_looks(looking: Page, folder: Path) -> None:
    before = contents(folder)
    assert looking.ask("/api/about").json["may_write"] is False
    assert len(writes()) == 7
    for method, address in writes():
        answer = looking.ask(address, method, {})
        assert answer.status == 403 and "--control" in answer.json["error"], address
    for path in ("/api/sessions", "/api/sessions/example_forte"):
        assert looking.ask(path).status == 200
    assert contents(folder) == before


def test_other_sites_cannot_write_with_control(writing: Page, folder: Path) -> None:
    before = contents(folder)
    for headers in (
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": None},
        {"Host": "evil.example"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Content_Type": "text/plain"},  # what a form of another site can send without being asked
        {"Content_Type": "application/x-www-form-urlencoded"},
        {"Content_Type": None},
    ):
        for method, address in writes():
            if method == "POST" or "Content_Type" not in headers:
                assert writing.ask(address, method, {}, **headers).status in (403, 415), (address, headers)
    assert writing.ask(ANNOTATIONS, "POST", [1]).status == 400
    assert contents(folder) == before


def test_what_is_told_all_the_time_is_told_to_this_page_only(looking: Page) -> None:
    path = "/live/example_forte"
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Host": "evil.example"}):
        with pytest.raises(Exception, match="HTTP 403"):
            heard(looking, path, **headers)
    ((first,), _) = heard(looking, path)
    assert not json.loads(first)["recording"]


def test_an_annotation_is_written_as_the_command_writes_it(writing: Page, folder: Path) -> None:
    assert writing.ask(ANNOTATIONS, "POST", NOTE).status == 200
    session = Session.open(folder / "example_forte")
    assert session.trial(2).rejected == NOTE["reason"]
    seen = writing.ask("/api/sessions/example_forte").json
    assert [trial["rejected"] for trial in seen["trials"]] == [None, NOTE["reason"], None]
    assert seen["annotations"][0]["author"] == "ana"
    (row,) = writing.ask("/api/sessions").json["sessions"]
    assert (row["trials"], row["rejected"], row["status"]) == (3, 1, "complete")
    assert writing.ask(ANNOTATIONS, "POST", {**NOTE, "kind": "accept", "reason": "was outside"}).status == 200
    assert Session.open(folder / "example_forte").trial(2).rejected is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"trial": 9}, "no trial 9"),
        ({"trial": "2"}, "trial '2'"),
        ({"trial": True}, "trial True"),
        ({"trial": -1}, "trial -1"),
        ({"kind": "delete"}, "kind 'delete'"),
        ({"kind": ["reject"]}, "kind ['reject']"),
        ({"reason": " "}, "no reason"),
        ({"reason": None}, "reason"),
        ({"reason": "x" * 2001}, "2000"),
        ({"author": 5}, "author"),
        ({"kind": "accept"}, "not rejected"),
    ],
)
def test_what_cannot_be_noted_is_refused_in_one_line(
    writing: Page, folder: Path, change: dict[str, object], words: str
) -> None:
    answer = writing.ask(ANNOTATIONS, "POST", {**NOTE, **change})
    assert answer.status == 400 and words in answer.json["error"] and "\n" not in answer.json["error"]
    assert not (folder / "example_forte" / "annotations.jsonl").exists()


def test_names_lead_nowhere_but_to_sessions(looking: Page, folder: Path) -> None:
    (folder / "no_session").mkdir()
    (folder.parent / "secret").mkdir()
    (folder.parent / "secret" / "session.toml").write_text("")
    (folder / "example_forte" / "report.html").symlink_to("/etc/passwd")
    (folder / "example_forte" / "linked.csv").symlink_to(folder.parent / "secret" / "session.toml")
    for name in ("..", "%2e%2e", "..%2fsecret", "no_session", "%00", "x" * 5000, "..%5csecret"):
        assert looking.ask(f"/api/sessions/{name}").status in (400, 404), name
    for path in (
        "report.html",
        "linked.csv",
        "rig.toml",
        "..%2f..%2fsecret%2fsession.toml",
        "trial_0001.h5",
        "%00.csv",
    ):
        assert looking.ask(f"/report/example_forte/{path}").status == 404, path


def test_only_the_pages_own_files_are_given_out(looking: Page) -> None:
    outside = ("../server.py", "..%2fserver.py", "%2e%2e/server.py", "%2fetc%2fpasswd", "", "%00")
    for path in (*(f"/web/{name}" for name in outside), "/drawing/compiler.js", "/drawing/..%2f__init__.py"):
        assert looking.ask(path).status in (400, 403, 404), path
    for name in ("bench.css", "live.js"):
        assert looking.ask(f"/web/{name}").status == 200


def test_a_report_is_boxed_in(looking: Page, folder: Path) -> None:
    (folder / "example_forte" / "report.html").write_text("<script>fetch('/api/sessions')</script>")
    (folder / "example_forte" / "curves").mkdir()
    (folder / "example_forte" / "curves" / "key.csv").write_text("time_s\n")
    answer = looking.ask("/report/example_forte/report.html")
    policy = answer.headers["Content-Security-Policy"]
    assert answer.status == 200 and policy.startswith("sandbox ") and "allow-same-origin" not in policy
    assert "connect-src" not in policy and "default-src 'none'" in policy and "frame-ancestors 'self'" in policy
    assert looking.ask("/report/example_forte/curves/key.csv").status == 200


def test_several_sessions_are_compared_by_their_names(writing: Page, folder: Path) -> None:
    for names in (None, "example_forte", [], ["example_forte"], ["example_forte"] * 2, [1, 2], ["x"] * 9):
        answer = writing.ask("/api/comparisons", "POST", {"sessions": names})
        assert answer.status == 400 and "2 to 8" in answer.json["error"], names
    answer = writing.ask("/api/comparisons", "POST", {"sessions": ["example_forte", "../x"]})
    assert answer.status == 404 and "no session" in answer.json["error"]
    assert writing.ask("/api/comparisons").json == {"comparisons": []}
    made = folder / "comparisons" / "2026-11-22T100000Z"
    made.mkdir(parents=True)
    (made / "report.html").write_text("<p>two</p>")
    assert writing.ask("/api/comparisons").json == {"comparisons": [made.name]}
    answer = writing.ask(f"/report-of-several/{made.name}/report.html")
    assert answer.body == b"<p>two</p>" and answer.headers["Content-Security-Policy"].startswith("sandbox ")
    for path in (f"{made.name}/..%2f..%2fexample_forte%2frig.toml", "..%2fexample_forte/report.html", "x/report.html"):
        assert writing.ask(f"/report-of-several/{path}").status == 404, path
    assert [row["name"] for row in writing.ask("/api/sessions").json["sessions"]] == ["example_forte"]


def test_a_hostile_folder_harms_nothing(looking: Page, folder: Path) -> None:
    """Broken, huge, endless and misnamed files: each is a row or a line of reason, and the others are shown."""
    good = (folder / "example_forte" / "session.toml").read_text()

    def session(name: str, text: str = good) -> Path:
        (folder / name).mkdir()
        (folder / name / "session.toml").write_text(text)
        return folder / name

    session("<img src=x onerror=alert(1)>", good.replace('operator = "', 'operator = "<script>alert(1)</script>'))
    session("not toml", "x = [")
    session("deep", "x = " + "[" * 5000 + "]" * 5000)
    (session("huge text") / "annotations.jsonl").write_bytes(b"\0" * 21_000_000)
    (session("film") / "trial_0001.mraw").touch()
    os.truncate(folder / "film" / "trial_0001.mraw", 3_000_000_000_000)
    (folder / "film" / "trial_0001.h5").touch()
    os.truncate(folder / "film" / "trial_0001.h5", 3_000_000_000)
    results = session("results")
    for i, text in enumerate(("[", "[]", "{}", '{"verdict_lines": 3}', "[" * 20_000)):
        (session(f"results {i}") / "results.json").write_text(text)
    (results / "results.json").touch()
    os.truncate(results / "results.json", 3_000_000_000)
    if hasattr(os, "mkfifo"):
        os.mkfifo(session("pipe") / "annotations.jsonl")
        os.mkfifo(session("pipe 2") / "trial_0001.h5")
        os.mkfifo(session("pipe 4") / "trial_0001.mraw")
        (folder / "pipe 3").mkdir()
        os.mkfifo(folder / "pipe 3" / "session.toml")
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "example_forte" / "trial_0002.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    rows = {row["name"]: row for row in looking.ask("/api/sessions").json["sessions"]}
    assert rows["example_forte"]["status"] == "2 complete, 1 unreadable"
    assert rows["<img src=x onerror=alert(1)>"]["operator"].startswith("<script>")  # data, told as data
    for name in ("not toml", "deep", "huge text", *(["pipe"] if "pipe" in rows else [])):
        assert rows[name]["status"] == "unreadable" and rows[name]["problem"], name
    assert rows["film"]["status"] == "unreadable" and rows["film"]["trials"] == 1
    for name in ("results", *(f"results {i}" for i in range(5))):
        assert "results.json" in rows[name]["problem"] and rows[name]["status"] == "no trials", name
    assert "loop" not in rows and "pipe 3" not in rows
    for name in rows:
        quoted = quote(name)
        answer = looking.ask(f"/api/sessions/{quoted}")
        assert answer.status == 200, (name, answer.body[:200])
        for path in (f"review/{quoted}/1", f"film/{quoted}/1", f"outlines/{quoted}/1", f"review/{quoted}/1/animation"):
            answer = looking.ask(f"/api/{path}")
            good = name == "example_forte" and "outlines" not in path
            assert answer.status in ((200,) if good else (200, 400, 404)), (path, answer.body[:200])
            assert answer.status == 200 or "\n" not in answer.json["error"]
        assert looking.ask(f"/film/{quoted}/1/0-1").status == 404, name


def test_the_row_tells_what_the_report_says_and_whether_it_is_still_so(writing: Page, folder: Path) -> None:
    session = Session.open(folder / "example_forte")
    seals = {trial.path.stem: trial.sha256 for trial in session.trials}
    rows = [{"trial": n, "reason": ""} for n in (1, 2, 3)]
    findings = [{"text": "encoder <i>key</i> turned"}, {"text": "encoder <i>key</i> turned"}]
    results = {
        "verdict_lines": ["Model a against 3 trials: agrees."],
        "results": [{"outcome": "agrees", "provenance": {"trials_sha256": seals}}],
        "tables": {"findings": findings, "trials": rows},
    }
    for name, text in (("results.json", json.dumps(results)), ("report.html", "<p>report</p>")):
        (folder / "example_forte" / name).write_text(text)

    def row() -> dict[str, object]:
        (found,) = writing.ask("/api/sessions").json["sessions"]
        return dict(found)

    assert (row()["verdict"], row()["n_findings"], row()["stale"]) == ("agrees", 1, False)
    writing.ask(ANNOTATIONS, "POST", {**NOTE, "kind": "note"})
    assert row()["stale"] is False  # a note changes no report
    writing.ask(ANNOTATIONS, "POST", NOTE)
    assert row()["stale"] is True
    results["tables"]["trials"][1]["reason"] = "rejected: cable"  # type: ignore[index,call-overload]
    (folder / "example_forte" / "results.json").write_text(json.dumps(results))
    assert row()["stale"] is False
    seals["trial_0003"] = "0" * 64
    (folder / "example_forte" / "results.json").write_text(json.dumps(results))
    assert row()["stale"] is True


def test_a_report_of_an_earlier_version_is_read_or_refused_in_one_line(writing: Page, folder: Path) -> None:
    seals = {trial.path.stem: trial.sha256 for trial in Session.open(folder / "example_forte").trials}
    seventh = {
        "schema_version": 7,
        "verdict_lines": ["differs."],
        "results": [{"outcome": "differs", "provenance": {"trials_sha256": seals}}],
        # without the columns `part` and `left_by_noise` of version 8
        "tables": {"findings": [], "trials": [], "compatible_changes": [{"set": 1, "cause": "key.mass"}]},
    }

    def row(results: dict[str, object]) -> dict[str, object]:
        (folder / "example_forte" / "results.json").write_text(json.dumps(results))
        (found,) = writing.ask("/api/sessions").json["sessions"]
        return dict(found)

    (folder / "example_forte" / "report.html").write_text("<p>report</p>")
    found = row(seventh)
    assert (found["verdict"], found["sentence"], found["problem"]) == ("differs", "differs.", "")
    for name in ("verdict_lines", "results", "tables"):
        found = row({key: value for key, value in seventh.items() if key != name})
        assert found["problem"] == f"results.json of version 7 lacks '{name}'; make the report again"
        assert found["status"] == "complete"  # the session itself is shown
