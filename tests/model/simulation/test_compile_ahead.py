"""A first run compiles on two processors; a warm one starts nothing."""

from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import model
from model.kernels import compile as compiling
from model.simulation import compile_ahead as ahead


def test_nothing_is_started_where_kernels_are_in_the_cache_or_cannot_be_kept(
    action: model.Action, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("a process was started")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    whole = model.load_scene("whole")
    monkeypatch.setattr(compiling, "FOLDER", None)
    assert ahead.compile_ahead([whole]) is None
    warm = tmp_path / "integrators_0"
    warm.mkdir()
    (warm / "rosenbrock.integrate-113.py311.nbi").touch()
    monkeypatch.setattr(compiling, "FOLDER", tmp_path)
    assert ahead.compile_ahead([whole]) is None
    (warm / "rosenbrock.integrate-113.py311.nbi").unlink()
    monkeypatch.setattr(ahead, "is_cached", lambda tables: True)
    assert ahead.compile_ahead([whole]) is None
    monkeypatch.setattr(ahead, "is_cached", lambda tables: False)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    assert ahead.compile_ahead([whole]) is None


def test_a_process_that_cannot_be_started_is_no_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(compiling, "FOLDER", tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "absent"))
    assert ahead.compile_ahead([model.load_scene("key")]) is None


def test_the_process_beside_calls_what_it_is_told_to(monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[str] = []
    module = ModuleType("told")
    module.__dict__["call_once"] = lambda: called.append("told")
    monkeypatch.setitem(sys.modules, "told", module)
    monkeypatch.setattr(
        sys, "stdin", SimpleNamespace(buffer=io.BytesIO(pickle.dumps(([], False, False, "told:call_once"))))
    )
    ahead.main()
    assert called == ["told"]
