"""The one runner of the benchmarks: its registry, what is resumed, the page of figures, and commands of the pages."""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import figures, runner
from tests.test_docs import PAGES

ROOT = Path(__file__).parents[2]
ENTRIES = runner.registry()
CALL = re.compile(r"python -m benchmarks ([a-z]\w+)([^`\n]*)")


@pytest.mark.parametrize("name", ENTRIES)
def test_a_benchmark_has_a_claim_and_two_sizes_and_measures_what_exists(name: str) -> None:
    entry = ENTRIES[name]
    assert entry["full"].items() <= vars(runner.parsed(name, [])).items()
    work = f"def {name if 'module' in entry else 'main'}(run: Run)"
    text = (ROOT / "benchmarks" / f"{entry.get('module', name)}.py").read_text(encoding="utf-8")
    assert work in re.sub(r"\((asked|given|args): Run", "(run: Run", text)
    assert entry["claim"] and not entry["claim"].endswith(".")
    assert entry["measures"] and not [
        path for path in entry["measures"] if not (ROOT / path.removeprefix(":!")).exists()
    ]
    assert {key: type(value) for key, value in entry["quick"].items()} == {
        key: type(entry["full"][key]) for key in entry["quick"]
    }


def test_every_benchmark_is_registered() -> None:
    files = [path for path in (ROOT / "benchmarks").glob("*.py") if path.stem not in ("runner", "__main__")]
    assert {path.stem for path in files if "\ndef main(" in path.read_text(encoding="utf-8")} == {
        name for name in ENTRIES if "module" not in ENTRIES[name]
    }


def test_options_are_the_full_size_and_quick_changes_it() -> None:
    full, quick = runner.parsed("tracking_stress", []), runner.parsed("tracking_stress", ["--quick", "--seeds", "3"])
    assert (full.seeds, full.kinds, full.textures) == (20, [], ["speckle", "wood", "fine"])
    assert (quick.seeds, quick.textures) == (3, ["speckle"])
    assert runner.parsed("regulation_sweep", ["--seeds", "4,9"]).seeds == [4, 9]
    assert runner.parsed("any_machine", ["--list", "--", "-m", "slow"]).rest == ["-m", "slow"]


def test_what_the_file_holds_is_not_computed_again(tmp_path: Path) -> None:
    made: list[int] = []

    def square(number: int) -> dict[str, int]:
        made.append(number)
        return {"square": number**2}

    def run(numbers: range, **options: object) -> runner.Run:
        one = runner.Run(benchmark="squares", results=tmp_path / "cases.jsonl", **options)
        one.found = {key: row["square"] for (key,), row in one.cases([(n,) for n in numbers], square)}
        return one

    assert run(range(2)).found == {0: 0, 1: 1}
    again = run(range(4))
    assert again.found == {0: 0, 1: 1, 2: 4, 3: 9} and made == [0, 1, 2, 3] and again.left == 0
    late = run(range(6), minutes=0.0)
    assert late.found == again.found and late.left == 2 and made == [0, 1, 2, 3]
    assert runner.Run(benchmark="other", results=tmp_path / "cases.jsonl").results.read_text().count("squares") == 4


def test_processes_give_the_cases_in_their_order() -> None:
    run = runner.Run(benchmark="roots")
    assert list(run.cases([(4.0,), (9.0,), (16.0,)], abs, workers=2)) == [((x,), x) for x in (4.0, 9.0, 16.0)]


def test_a_table_marks_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    table = runner.Table("name:6s", "share:7.2f", "of:d")
    table.row("one", 0.25, 4)
    table.row("two", float("nan"), None)
    assert capsys.readouterr().out.splitlines() == ["name      share  of", "one        0.25   4", "two           -   -"]


def test_limits_of_a_rate() -> None:
    """By the beta distribution: of no hits in n the upper limits are 1 - 0.025^(1/n) and 1 - 0.05^(1/n)."""
    assert runner.interval(0, 20) == pytest.approx((0.0, 1 - 0.025 ** (1 / 20)))
    assert runner.at_most(0, 20) == pytest.approx(1 - 0.05 ** (1 / 20))
    assert runner.at_most(5, 5) == 1.0


def test_what_is_wrong_with_a_call_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert runner.main(["nonsense"]) == 2
    assert "benchmark: found nonsense" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="same_results: --against CHECKOUT is missing"):
        runner.main(["same_results"])
    with pytest.raises(SystemExit, match="--write: found --quick, allowed is the full size"):
        runner.main(["same_results", "--quick", "--write"])


@pytest.mark.parametrize(("answer", "code"), [(None, 0), (True, 0), (False, 1), (np.bool_(False), 1)])
def test_a_wrong_answer_is_the_exit_code(answer: object, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib, "import_module", lambda name: SimpleNamespace(main=lambda run: answer))
    assert runner.main(["stability", "--quick"]) == code


def test_the_page_of_figures_is_what_the_results_say() -> None:
    rows = figures.rows()
    without_marks = figures.MARK.sub("", figures.PAGE.read_text(encoding="utf-8"))
    assert without_marks == figures.page(rows, [""] * len(rows)), "run: python -m benchmarks figures"
    assert len({row["row"] for row in rows}) == len(rows)
    assert not [row["row"] for row in rows if not (row["benchmark"] in ENTRIES or row.get("measures"))]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", row["date"]) and row["commit"] and row["machine"] for row in rows)


def test_a_figure_older_than_its_code_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def commit(name: str, text: str) -> str:
        (tmp_path / name).write_text(text, encoding="utf-8")
        own = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path)]
        subprocess.run([*own, "add", "."], check=True)
        subprocess.run([*own, "commit", "-q", "-m", name], check=True)
        return figures.git("rev-parse", "--short", "HEAD")

    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "RESULTS", tmp_path / "results.jsonl")
    monkeypatch.setattr(figures, "PAGE", tmp_path / "figures.md")
    commit("code.py", "a = 1")
    figures.RESULTS.touch()
    figures.store("speed", "4 ms", "`measure`")
    (row,) = figures.rows()
    commit("other.py", "1")
    assert figures.changed_since(row, ["code.py"]) == ""
    commit("code.py", '"""Said, not done."""\n\na = 1  # one')
    (tmp_path / "code.py").rename(tmp_path / "moved.py")
    commit("other.py", "2")
    assert figures.changed_since(row, ["code.py", "moved.py"]) == ""
    (tmp_path / "moved.py").rename(tmp_path / "code.py")
    changed = commit("code.py", "a = 2")
    assert figures.changed_since(row | {"commit": "0123abcd"}, ["other.py"]) == "unknown"
    assert figures.changed_since(row, ["code.py"]).startswith(changed)
    text = figures.page([row], [figures.changed_since(row, ["code.py"])])
    assert f"; **stale**: {changed}" in text and "| 4 ms |" in text
    figures.store("speed", "3 ms")
    assert [(one["figure"], one["command"]) for one in figures.rows()] == [("3 ms", "`measure`")]
    with pytest.raises(SystemExit, match="--row: found size, allowed speed"):
        figures.store("size", "9")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_benchmarks_and_options_named_in_a_page_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "python benchmarks/" not in text
    for name, rest in CALL.findall(text):
        if name == "figures":
            continue
        assert name in ENTRIES, f"{page.name}: python -m benchmarks {name}"
        words = shlex.split(re.sub(r"[\[\]…]", "", rest.split("; ")[0]), comments=True)
        known = runner.parser(name, ENTRIES[name], "").parse_known_args(words[: (words + ["--"]).index("--")])[1]
        assert not [word for word in known if word.startswith("--")], f"{page.name}: {name}: {known}"


def test_mutations_are_of_lines_that_are_there_once() -> None:
    """But for a tenth: code changes, and a mutation whose line is gone is told and not counted."""
    mutations = tomllib.loads((ROOT / "benchmarks" / "mutations.toml").read_text(encoding="utf-8"))["mutation"]
    gone = []
    for number, mutation in enumerate(mutations):
        path = ROOT / mutation["file"]
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        gone += [number] * ([line.strip() for line in lines].count(mutation["line"]) != 1)
        assert mutation["line"] != mutation["becomes"]
    assert len(gone) <= len(mutations) // 10, gone
