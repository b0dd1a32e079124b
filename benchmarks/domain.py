"""Leave one kind of stroke out of a fit: is the error within the band inside the domain, and is the rest flagged?

A specimen of the virtual bench (arm, balance rail and shank, which the model lacks; frictions drawn) plays six kinds of
strokes, each two times to fit and twice to predict, with strength drawn within 15 % and pace within 10. A set of six
parameters and two black boxes are fitted to all kinds, and to five of them, each left out in turn. The band about the
hammer holds 95 % of the errors of each fitted stroke in each phase of the key (*largest* of `prediction_band`). A
stroke is within it when 90 % of its samples are. Prints by kind how many strokes are called inside and outside, how
many of each are within the band, and which of model and rivals is nearest how often.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import model
from benchmarks.bench_strokes import KINDS, play
from benchmarks.runner import Run, Table, interval
from validation.conventions import HAMMER, Array
from validation.events.strikes import key_phases
from validation.measurement.trial import MeasuredTrial, measure
from validation.prediction.black_boxes import fit_black_boxes
from validation.prediction.model_under_test import ModelUnderTest
from validation.statistics.domain import place
from validation.statistics.rivals import stroke_example, stroke_features

EFFECTS = ("balance_rail", "shank")
FREE = {
    "key.joint_friction.A": 0.5, "hammer.joint_friction.A": 0.5, "contact07.friction.A": 0.4,
    "contact04.friction.A": 0.4, "contact01.normal.D": 0.5, "repetition_spring.stiffness": 0.15,
}  # fmt: skip
"""Free parameters and the widths of their priors, of logarithms; the specimen's are drawn half as wide."""
STEP_S, LATE_S = 0.004, 0.3
"""Between the samples that are compared; a stroke ends so long after its force."""
TOLERANCE = 1e-4
SCATTER = np.array([2e-3, 3e-3, 2e-2])
"""Of key, whippen and hammer, rad: what this model misses them by."""
LEAST = 0.005
"""Least half width of the band, of the hammer's range."""
COVER, LEVEL = 0.9, 0.95


class Seen:
    """A trial as it is compared: its times (m,), s, the turns measured there (m, 3), rad, and phases (m,)."""

    def __init__(self, m: MeasuredTrial) -> None:
        self.m = m
        end = min(
            float(m.force.time_s[-1]), float(m.time_s[m.force.force_n > 0.05 * m.force.force_n.max()][-1]) + LATE_S
        )
        self.time_s = np.arange(m.quiet.onset_s - 0.02, end, STEP_S)
        self.turn = np.column_stack([np.interp(self.time_s, m.time_s, column) for column in m.change_rad.T])
        key = self.turn[:, 0] * np.sign(self.turn[np.argmax(np.abs(self.turn[:, 0])), 0])
        self.phase = key_phases(key, STEP_S)
        self.features = stroke_features(m)

    def by(self, action: model.Action) -> Array:
        """Turns by a model (m, 3), rad; not a number where it cannot run."""
        try:
            rest = model.rest_state(action, force_n=self.m.force.preload_n)
            run = model.simulate(
                action, self.m.force.time_s, self.m.force.force_n, tolerance=TOLERANCE, initial=rest,
                output_time_s=self.time_s,
            )  # fmt: skip
        except model.ModelError:
            return np.full(self.turn.shape, np.nan)
        return np.asarray((run.angle_rad - rest.angle_rad)[:, [0, 1, HAMMER]])


def least_misfit(errors: Callable[[Array], Iterable[Array]], n: int, most: int) -> Array:
    """The n numbers, in widths of their priors, with the least robust misfit: each stroke's ``errors``, in scatters,
    count as 60 values; ``most`` evaluations."""

    def residual(z: Array) -> Array:
        robust = [np.sign(e) * np.sqrt(2 * (np.sqrt(1 + e**2) - 1)) * np.sqrt(60.0 / e.size) for e in errors(z)]
        return np.concatenate([z, *robust])

    def slopes(z: Array) -> Array:
        here, step = residual(z), 0.1
        return np.column_stack([(residual(z + step * unit) - here) / step for unit in np.eye(n)])

    return np.asarray(least_squares(residual, np.zeros(n), jac=slopes, bounds=(-3, 3), max_nfev=most).x)


def fitted(base: model.Action, strokes: list[Seen]) -> model.Action:
    """The set with its free parameters fitted to some strokes."""

    def action_of(z: Array) -> model.Action:
        moved = zip(FREE.items(), z, strict=True)
        return base.with_values({path: base[path] * float(np.exp(width * x)) for (path, width), x in moved})

    def errors(z: Array) -> Iterator[Array]:
        for stroke in strokes:
            yield np.nan_to_num((stroke.by(action_of(z)) - stroke.turn) / SCATTER, nan=5.0).ravel()

    return action_of(least_misfit(errors, len(FREE), 5))


def specimen(seed: int, number: int) -> list[dict[str, Any]]:
    """Rows of one specimen: stroke, what was left out, its place, share within the band, errors of all."""
    base = model.load_action("hirschkorn2004")
    tested, rng = ModelUnderTest(base), np.random.default_rng([seed, number])
    changed = {path: base[path] * (np.exp(0.5 * width * rng.standard_normal()) - 1) for path, width in FREE.items()}
    strokes: dict[str, list[Seen]] = {}
    for kind in KINDS:
        data = [play(kind, 1000 * seed + number, k, effects=EFFECTS, changed=changed).data for k in range(1, 5)]
        measured = [measure(one, None, tested.geometry_at(one.force_info.preload_n)) for one in data]
        strokes[kind] = [Seen(m) for m in measured]
    rows = []
    for out in ("", *KINDS):
        train = [one for kind, every in strokes.items() if kind != out for one in every[:2]]
        action, boxes = fitted(base, train), fit_black_boxes([stroke_example(one.m) for one in train])
        half: dict[int, float] = {}
        for one in train:
            away = np.abs(one.by(action)[:, 2] - one.turn[:, 2])
            for phase in np.unique(one.phase).tolist():
                own = float(np.quantile(away[one.phase == phase], LEVEL))
                half[phase] = max(half.get(phase, 0.0), own)
        widest = max(half.values())
        for kind, every in strokes.items():
            for one in every[2:]:
                where = place(one.features, [other.features for other in train])
                made = {"model": one.by(action), "unfitted": one.by(base)}
                made |= {
                    n: box.answers(one.m.force.time_s, one.m.force.force_n, one.time_s) for n, box in boxes.items()
                }
                reach = np.array([max(half.get(int(p), widest), LEAST * np.ptp(one.turn[:, 2])) for p in one.phase])
                within = float(np.mean(np.abs(made["model"][:, 2] - one.turn[:, 2]) <= reach))
                rms = {n: float(np.sqrt(np.mean((a[:, 2] - one.turn[:, 2]) ** 2))) for n, a in made.items()}
                assert where is not None
                rows.append({"out": out, "kind": kind, "outside": where.outside, "distance": min(where.distance, 99.0),
                             "why": where.why, "within": within, **rms})  # fmt: skip
    return rows


def main(run: Run) -> bool:
    """Print the tables; whether 95 % are within the band inside, and flagged of those beyond it."""
    rows = [row for _, found in run.cases([(run.seed, k) for k in range(run.specimens)], specimen) for row in found]
    table = Table(
        "fitted to all but:<14s", "strokes:<18s", "n:5d", "inside:6d", "of these within:8d", "outside:7d", "within:8d"
    )
    for out in ("", *KINDS):
        for own in (False, True):
            part = [row for row in rows if row["out"] == out and (row["kind"] == out) == own]
            held = [[row["within"] >= COVER for row in part if row["outside"] == side] for side in (False, True)]
            if part:
                name = "of this kind" if own else "of the kinds fitted"
                table.row(out or "none", name, len(part), len(held[0]), sum(held[0]), len(held[1]), sum(held[1]))
    inside = [row["within"] >= COVER for row in rows if not row["outside"]]
    beyond = [row["outside"] for row in rows if row["within"] < COVER and row["kind"] == row["out"]]
    low, high = interval(sum(inside), len(inside))
    print(f"inside and within the band: {sum(inside)} of {len(inside)} ({low:.3f} to {high:.3f})")
    low, high = interval(sum(beyond), len(beyond))
    print(
        f"of the kind left out and beyond the band, flagged: {sum(beyond)} of {len(beyond)} ({low:.3f} to {high:.3f})"
    )
    nearest: dict[bool, Counter[str]] = {False: Counter(), True: Counter()}
    for row in rows:
        errors = {name: row[name] for name in ("model", "unfitted", "polynomial", "fir")}
        nearest[row["outside"]][min(errors, key=errors.__getitem__)] += 1
    print(f"nearest inside: {dict(nearest[False])}; outside: {dict(nearest[True])}")
    share = (sum(inside) / max(len(inside), 1), sum(beyond) / max(len(beyond), 1))
    run.figure("domain", f"{sum(inside)} of {len(inside)}; {sum(beyond)} of {len(beyond)}")
    return min(share) >= LEVEL
