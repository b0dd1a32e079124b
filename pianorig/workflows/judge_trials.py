"""Trials judged while a session is recorded, in a process of its own: what it does cannot slow the recorder.

`judge_during_recording` starts ``python -m pianorig.workflows.judge_trials FOLDER MODEL``, which looks for sealed
trials in the folder, prints what it finds of each and writes it to ``derived/judged/trial_NNNN.json`` (`page.live`
reads these). It runs at lower priority, on one thread, and ends with its standard input, at the latest the recorder.
The recorder only passes its lines on, from a thread. Killed, it takes no sample and no trial with it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import model
from model.errors import ModelError
from pianorig.console.overrides import load_model, split_model
from pianorig.console.progress import say

LOOK_EVERY_S = 0.1  # at the session, for a sealed trial
PATIENCE_S = 60.0  # for the last trials, once the recording has ended: the first time kernels are compiled
PATIENCE_AFTER_FAILURE_S = 2.0  # once it was stopped or has failed
LOWER_PRIORITY = 10  # by so much a judge is nicer than the recorder: half of Unix's range
FOLDER = ("derived", "judged")


def is_model(action: str) -> bool:
    """Whether the text names a model that can be simulated: a built-in action or a path that ends in ``.toml``, with or
    without changes (``action: --set …``); a mere description is none."""
    name = split_model(action)[0]
    if name.endswith(".toml"):
        return True
    try:
        model.load_action(name)
    except ModelError:
        return False
    return True


@contextmanager
def judge_during_recording(folder: Path, action: str, quiet: bool = False) -> Iterator[None]:
    """Context in which a process of its own compares every trial sealed in ``folder`` with the model ``action`` and its
    lines are printed (unless quiet); does nothing where ``action`` is no model."""
    if not is_model(action):
        yield
        return
    chosen = load_model(action)  # refused before anything moves
    model.choice_of(chosen).need_played_key(chosen.name)
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", __name__, str(folder), action],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env={**os.environ, **one_thread, "PYTHONIOENCODING": "utf-8"},
        start_new_session=sys.platform != "win32",  # Ctrl-C is the recorder's
    )

    def pass_on() -> None:
        assert process.stdout is not None
        with process.stdout as said:
            for line in said:
                say(line.rstrip(), quiet)

    listener = threading.Thread(target=pass_on, name="judged trials", daemon=True)
    listener.start()
    patience_s = PATIENCE_S
    try:
        yield
    except BaseException:
        patience_s = PATIENCE_AFTER_FAILURE_S
        raise
    finally:
        with suppress(OSError):
            assert process.stdin is not None
            process.stdin.close()
        try:
            code = process.wait(patience_s)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        listener.join(PATIENCE_S)
        if code:
            say(f"the judging of trials ended early (status {code}); the recording is not touched by it", quiet)


def judge_trials(folder: Path, action: str, has_ended: threading.Event, tell: Callable[[str], None]) -> None:
    """Compare every trial that appears in ``folder`` with a model, pass the lines to ``tell`` and write each judgement
    as JSON, until ``has_ended`` is set and all are judged."""
    # start-up: two seconds that the recorder does not spend
    from rig.atomic_write import write_text
    from rig.errors import RigError
    from rig.session import Session
    from validation import TrialJudge
    from validation.errors import ValidationError

    judge, judged = TrialJudge(load_model(action)), set[int]()
    while True:
        last = has_ended.wait(LOOK_EVERY_S)
        with suppress(RigError):  # no session yet
            session = Session.open(folder, require_trials=False)
            for trial in session.trials:
                if trial.number in judged:
                    continue
                judged.add(trial.number)
                try:
                    found = judge.judge(session, trial.number)
                except (RigError, ValidationError, ModelError) as error:
                    tell(f"trial {trial.number}: not compared: {error}")
                    continue
                tell("\n".join(found.lines()))
                file = folder.joinpath(*FOLDER, f"trial_{trial.number:04d}.json")
                file.parent.mkdir(parents=True, exist_ok=True)
                write_text(file, json.dumps(found.content(), allow_nan=False))
        if last:
            return


def main(folder: str, action: str) -> None:
    """Run `judge_trials` as a process of low priority that prints its lines; the recording has ended when standard
    input does."""
    if hasattr(os, "nice"):
        os.nice(LOWER_PRIORITY)
    has_ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        has_ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    try:
        judge_trials(Path(folder), action, has_ended, lambda text: print(text, flush=True))
    except Exception as problem:
        print(f"judging: defect: {type(problem).__name__}: {problem}", flush=True)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main(*sys.argv[1:])
