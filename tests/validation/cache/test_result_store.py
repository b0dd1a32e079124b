"""Results of earlier runs: found by what entered them, never when anything that entered has changed."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from validation.cache import result_store
from validation.cache.content_hash import sha256_of
from validation.cache.result_store import PLACE, ResultStore
from validation.events.detect import make_absent_event


class Made:
    """Counts how often it is asked."""

    def __init__(self, value):
        self.value = value
        self.times = 0

    def __call__(self):
        self.times += 1
        return self.value


def test_a_result_is_computed_once_and_given_as_it_is_read_back(tmp_path):
    made = Made({"a": (1, 2.5, float("nan"), None), "b": np.float64(1 / 3)})
    first = ResultStore(tmp_path)
    given = first.value("scores", (1.0, np.arange(3)), made)
    again = first.value("scores", (1.0, np.arange(3)), made)
    assert first.save() == []
    later = ResultStore(tmp_path)
    read = later.value("scores", (1.0, np.arange(3)), made)
    assert made.times == 1
    for value in (given, again, read):
        assert value["a"][:2] == [1, 2.5] and math.isnan(value["a"][2]) and value["a"][3] is None
        assert value["b"] == 1 / 3
    assert first.summary() == {"scores": "0 of 2"}
    assert later.summary() == {"scores": "1 of 1"}


def test_of_several_results_those_that_are_missing_are_made_together(tmp_path):
    asked = []

    def make(places):
        asked.append(places)
        return [10 * i for i in places]

    first = ResultStore(tmp_path)
    assert first.values("draws", ["a", "b", "c"], make) == [0, 10, 20]
    assert first.values("draws", ["c", "new", "a"], make) == [20, 10, 0]
    assert asked == [[0, 1, 2], [1]]
    assert first.save() == []
    later = ResultStore(tmp_path)
    assert later.values("draws", ["b", "c"], make) == [10, 20] and len(asked) == 2
    assert later.values("draws", [], make) == []
    assert later.summary() == {"draws": "2 of 2"}


DIFFERENT = [
    1, 1.0, True, "1", None, (1,), ((1,),), (1, 2), ("1", "2"), ("12",), {"a": 1}, {"b": 1}, (), {},
    np.array([1]), np.array([1.0]), np.array([True]), np.array([[1.0]]), np.array([1.0], dtype=np.float32),
    np.array([1.0 + 1e-16 * 3]), np.array([-0.0]), np.array([0.0]), np.array([np.nan]), float("nan"), 0.0, -0.0,
    make_absent_event("rest"), make_absent_event("rest", "note"),
]  # fmt: skip


def test_values_that_differ_in_type_shape_or_one_bit_differ_in_hash():
    hashes = [sha256_of(value) for value in DIFFERENT]
    assert len(set(hashes)) == len(DIFFERENT)
    assert hashes == [sha256_of(value) for value in DIFFERENT]


def test_equal_content_has_equal_hash_whatever_its_layout():
    table = np.arange(12.0).reshape(3, 4)
    assert sha256_of(table[:, 1]) == sha256_of(np.array([1.0, 5.0, 9.0]))
    assert sha256_of(np.asfortranarray(table)) == sha256_of(table)
    assert sha256_of(np.float64(0.1)) == sha256_of(0.1)
    assert sha256_of({"a": np.float64(0.1), "b": 2.0}) == sha256_of({"a": 0.1, "b": 2.0})
    assert sha256_of({"a": 0.1, "b": 2.0}) != sha256_of({"a": 0.1, "b": 2})


@pytest.mark.parametrize("value", [object(), np.array([object()]), {1, 2}, b"bytes", lambda: 0])
def test_what_cannot_be_hashed_is_refused(value):
    with pytest.raises(TypeError, match="cannot be hashed"):
        sha256_of((1, value))


def test_another_kind_or_other_code_makes_it_again(tmp_path, monkeypatch):
    made = Made(1)
    first = ResultStore(tmp_path)
    first.value("scores", 1, made)
    first.value("events", 1, made)
    first.save()
    monkeypatch.setattr(result_store, "code_sha256", lambda *package: "other code")
    ResultStore(tmp_path).value("scores", 1, made)
    assert made.times == 3


@pytest.mark.parametrize("damage", ["byte", "cut", "empty", "other", "folder"])
def test_a_damaged_file_counts_as_none_and_is_replaced(tmp_path, damage):
    made = Made("right")
    first = ResultStore(tmp_path)
    first.value("scores", 1, made)
    first.save()
    file = tmp_path.joinpath(*PLACE)
    text = file.read_text()
    if damage == "folder":
        file.unlink()
        file.mkdir()
    else:
        new = {"byte": text.replace("right", "wrong"), "cut": text[:-4], "empty": "", "other": "\n\n\t\n"}[damage]
        file.write_text(new)
    second = ResultStore(tmp_path)
    assert second.value("scores", 1, made) == "right"
    assert made.times == 2
    notes = second.save()
    assert ["not kept" in note for note in notes] == [True] * (damage == "folder")
    if damage != "folder":
        assert file.read_text() == text


def test_two_runs_at_once_keep_what_both_have_made(tmp_path):
    one, two = ResultStore(tmp_path), ResultStore(tmp_path)
    one.value("scores", 1, Made("one"))
    two.value("scores", 2, Made("two"))
    one.save()
    two.save()
    later = ResultStore(tmp_path)
    assert [later.value("scores", i, Made("new")) for i in (1, 2)] == ["one", "two"]


def test_the_file_stays_small_and_what_was_used_last_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(result_store, "LARGEST_CHARACTERS", 1000)
    for i in range(20):
        store = ResultStore(tmp_path)
        store.value("scores", "used always", Made("x" * 100))
        store.value("scores", i, Made("y" * 100))
        assert store.save() == []
    file = tmp_path.joinpath(*PLACE)
    assert file.stat().st_size < 1200
    last = ResultStore(tmp_path)
    made = Made("new")
    last.value("scores", "used always", made)
    last.value("scores", 19, made)
    assert made.times == 0
    last.value("scores", 0, made)
    assert made.times == 1


def test_what_cannot_be_written_is_said_and_nothing_half_written_stays(tmp_path, monkeypatch):
    def full(self, data):
        raise OSError(28, "No space left on device")

    store = ResultStore(tmp_path)
    store.value("scores", 1, Made(1))
    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    store.count("predictions", reused=False, failure="no room")
    store.count("predictions", reused=False, failure="no room either")
    first, second = store.save()
    assert first == "2 predictions not kept for the next run: no room"
    assert second.startswith("scores not kept") and "No space left" in second
    assert list(tmp_path.joinpath(*PLACE).parent.iterdir()) == []


def test_threads_may_ask_at_once(tmp_path):
    store = ResultStore(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda i: store.value("scores", i % 5, Made(i % 5)), range(200)))
    assert found == [i % 5 for i in range(200)]
    assert store.summary() == {"scores": "0 of 200"}
