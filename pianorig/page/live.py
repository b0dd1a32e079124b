"""What is new in a recording since the last look: samples of every channel, and the state of the trial."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pianorig.page.catalogue import LARGEST_TRIAL_BYTES, open_session, shorten_text
from pianorig.workflows.judge_trials import FOLDER as JUDGED
from rig.errors import RigError
from rig.session import Trial, TrialData
from rig.session.live_view import JournalFollower
from rig.session.sealed_trial import read_trial
from rig.session.trial_head import TrialHead
from validation.curves.display_signs import SIGN, TITLE
from vision.output.colours import body_colour

MOST_FIGURES = 500  # trials with their figures: the last of a long session


class LiveStream:
    """Follows one session; `poll` as often as the page is drawn."""

    def __init__(self, folder: Path) -> None:
        self.session = open_session(folder)
        self._journal: JournalFollower | None = None
        self._sent = 0
        self._figures: dict[int, dict[str, Any]] = {}
        self._state: dict[str, Any] = {}
        self._judged: dict[str, Any] | None = None

    def poll(self) -> tuple[dict[str, Any] | None, bytes]:
        """State of the recording, or None where it has not changed since the last call, and the samples received since
        as bytes, empty for none.

        Samples: number of the first one (float64), then one row a sample of 32-bit numbers, in the order of the
        state's ``channels``.
        """
        samples = self._samples()
        state = self._recording_state()
        if state == self._state:
            return None, samples
        self._state = state
        return state, samples

    def _samples(self) -> bytes:
        """Samples that the journal received since the last call as bytes: number of the first (float64), then rows of
        float32, little-endian; empty where there are none."""
        journals = self.session.journals
        if not journals:
            self._journal = None
            return b""
        path = list(journals.values())[-1]
        if self._journal is None or self._journal.path != path:
            self._journal, self._sent = JournalFollower(path), 0
        follower = self._journal
        if not follower.poll() or follower.head is None:
            return b""
        new = [block for block in follower.blocks if block.first_sample >= self._sent]
        if not new:
            return b""
        part = follower.head.part(new, new[0].first_sample)
        self._sent = new[-1].first_sample + new[-1].force_n.size
        return struct.pack("<d", new[0].first_sample) + _live_rows(part, follower.first_count).tobytes()

    def _recording_state(self) -> dict[str, Any]:
        """State of the recording for the page by name: trial, plan, channels, sample rate, last judgement, free disk,
        and key figures of the last sealed trials, which are read once and kept."""
        head = None if self._journal is None else self._journal.head
        sealed = self.session.trials
        for trial in sealed[-MOST_FIGURES:]:
            if trial.number not in self._figures:
                self._figures[trial.number] = _trial_figures(trial.number, trial.path)
        plan = self.session.info.plan
        free_gb = shutil.disk_usage(self.session.path).free / 1e9
        return {
            "recording": head is not None,
            "trial": head.number if head is not None else (sealed[-1].number if sealed else 0),
            "trials": plan.trials,
            "condition": head.condition if head is not None else "",
            "started_utc": head.started_utc if head is not None else "",
            "rate_hz": head.sample_rate_hz if head is not None else 0.0,
            "planned_s": head.command_v.size / head.sample_rate_hz if head is not None else 0.0,
            "channels": [] if head is None else _channels(head),
            "simulated": self.session.info.simulated,
            "judged": self._last_judged(sealed),
            "disk_free_gb": round(free_gb, 1 if free_gb < 20 else 0),
            "figures": [
                {**self._figures[trial.number], "rejected": trial.rejected is not None}
                for trial in sealed[-MOST_FIGURES:]
            ],
        }

    def _last_judged(self, sealed: Sequence[Trial]) -> dict[str, Any] | None:
        """What the model says of the last judged among the ``sealed`` trials, as `validation.TrialJudgement.content`
        wrote it; None where none was judged.

        `pianorig.workflows.judge_trials` writes it while ``record --action MODEL`` runs, whole files one a trial.
        """
        if not self.session.path.joinpath(*JUDGED).is_dir():
            return None
        for trial in reversed(sealed):
            if self._judged is not None and self._judged["trial"] == trial.number:
                break
            file = self.session.path.joinpath(*JUDGED, f"{trial.path.stem}.json")
            with suppress(OSError, ValueError):
                self._judged = json.loads(file.read_text(encoding="utf-8"))
                break
        return self._judged


def _channels(head: TrialHead) -> list[dict[str, Any]]:
    """Columns of the samples, in their order, a dict each of name, title, unit (angles in degrees) and colour: force,
    encoders, motor command, further channels."""
    columns = [{"name": "force", "title": "Raw force", "unit": "N", "color": ""}]
    for i, encoder in enumerate(head.encoders):
        title = TITLE.get(encoder.name, encoder.name)
        columns.append({"name": encoder.name, "title": title, "unit": "°", "color": body_colour(encoder.name, i)})
    columns.append({"name": "motor_command", "title": "Motor command", "unit": "V", "color": ""})
    columns += [
        {"name": one.name, "title": shorten_text(one.name.replace("_", " ")), "unit": one.unit, "color": ""}
        for one in head.channels
    ]
    return columns


def _live_rows(part: TrialData, first_count: Any) -> np.ndarray:
    """Rows (n, k) float32: raw force, N; degrees turned since ``first_count`` (1, encoders), clockwise positive but for
    the whippen; command, V; further channels."""
    sign = np.array([SIGN.get(encoder.name, 1.0) for encoder in part.encoders])
    columns = [
        part.raw_force_n[:, None],
        np.degrees(part.convert_counts(first_count)) * sign,
        part.motor_command_v[:, None],
    ]
    if part.channel_values is not None:
        columns.append(part.channel_values)
    return np.ascontiguousarray(np.concatenate(columns, axis=1), dtype="<f4")


def _trial_figures(number: int, path: Path) -> dict[str, Any]:
    """Key figures of a sealed trial by name: status, reason, raw peak and rest force, N, largest turn of each body,
    degrees; force None and status ``unreadable`` where it cannot be read."""
    row: dict[str, Any] = {"trial": number, "status": "unreadable", "reason": ""}
    row |= {"raw_peak_force_n": None, "raw_rest_force_n": None, "turned_deg": {}}
    try:
        if path.stat().st_size > LARGEST_TRIAL_BYTES:
            return row
        data = read_trial(path)
    except (RigError, OSError) as error:
        return {**row, "reason": shorten_text(error)}
    row |= {"status": data.status, "reason": shorten_text(data.reason)}
    if data.n_valid:
        row["raw_peak_force_n"] = float(data.raw_force_n.max())
        before = data.raw_force_n[: max(int(data.blow_start_s * data.sample_rate_hz), 1)]
        row["raw_rest_force_n"] = float(before.mean())
        turned = np.abs(np.degrees(data.angle_rad)).max(axis=0)
        row["turned_deg"] = {one.name: float(deg) for one, deg in zip(data.encoders, turned, strict=True)}
    return row
