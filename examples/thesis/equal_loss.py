"""Laws of felt with memory at equal peak force and equal loss, so that what is left is the memory's own.

A law with memory put on a felt as it stands also presses harder and loses more or less than the thesis's law before it.
Here its share (epsilon or beta) and the height of its slow curve are fitted, in the blow itself, until the felt's
largest force and what it loses are those of the thesis's law; its second number (tau or eta) stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import model

Array = NDArray[np.float64]

RATE_HZ = 100_000.0  # a memory of 50 us is to be followed
TOLERANCE = 1e-6  # rad
NUMBERS = {"stulov": ("epsilon", "tau"), "hysteresis": ("beta", "eta")}
SHARES = {"stulov": np.linspace(0.02, 0.98, 49), "hysteresis": np.linspace(0.0125, 1.0, 80)}
ROUNDS, CLOSE = 12, 0.005  # fits, each along the press of the blow before; share of peak and loss that ends them
FELTS: Mapping[str, Sequence[str]] = {
    "hammer": ("contact12",),
    "key front": ("contact02",),
    "back check": ("contact04",),
    "all three": ("contact12", "contact02", "contact04"),
}


class Press(NamedTuple):
    """What a felt went through: times and depths with a sample before and after, largest force, work kept, J."""

    time_s: Array
    depth_m: Array
    peak_n: float
    loss_j: float


class Blow(NamedTuple):
    """A blow of an action: its measures, and the presses of felts by contact."""

    measures: model.study.BlowMeasures
    presses: dict[str, Press]


def play(action: model.Action, time_s: Array, force_n: Array, contacts: Sequence[str]) -> Blow:
    """Simulate a blow; felts that are never pressed are left out."""
    at = model.output_times(float(time_s[0]), float(time_s[-1]), RATE_HZ)
    moved = model.simulate(action, time_s, force_n, tolerance=TOLERANCE, output_time_s=at, contact_forces=True)
    measures = model.study.measure_blow(action, moved, np.interp(at, time_s, force_n))
    assert moved.contact_normal_n is not None
    found = {}
    for contact in (name for name in contacts if name in moved.contacts):
        c = moved.contacts.index(contact)
        pressed = moved.contact_normal_n[:, c] > 0.0
        near = np.flatnonzero(np.convolve(pressed, np.ones(3), "same") > 0.0)
        if len(near) < 3:
            continue
        inside = model.simulate(
            action, time_s, force_n, tolerance=TOLERANCE, output_time_s=at[near], inside=True
        ).inside
        assert inside is not None
        depth, force = inside.penetration_m[:, c], inside.normal_n[:, c]
        loss = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(np.maximum(depth, 0.0))))
        found[contact] = Press(at[near], depth, float(force.max()), loss)
    return Blow(measures, found)


def fit_law(plain: model.Action, given: model.Action, contact: str, law: str, wanted: Press) -> dict[str, float]:
    """Share and height of the curve with which a law has the wanted peak and loss along one press.

    Force is in proportion to the height, so that loss over peak belongs to the share alone.
    """
    share_name, second = NUMBERS[law]
    curve = {k: plain[f"{contact}.normal.{k}"] for k in "abc"}
    moved = np.diff(np.maximum(wanted.depth_m, 0.0))
    fixed = {second: given[f"{contact}.{law}.{second}"]}
    felts = [model.felt.NamedLaw(law, **curve, values={share_name: float(x)} | fixed) for x in SHARES[law]]
    forces = np.array([felt.response(wanted.time_s, wanted.depth_m).force_n for felt in felts])
    peaks = np.maximum(forces.max(axis=1), 1e-12)
    off = 0.5 * (forces[:, 1:] + forces[:, :-1]) @ moved / peaks - wanted.loss_j / wanted.peak_n
    crossing = np.flatnonzero(off[:-1] * off[1:] <= 0.0)
    if len(crossing):
        k = int(crossing[0])
        part = 0.0 if off[k] == off[k + 1] else off[k] / (off[k] - off[k + 1])
        share = float(SHARES[law][k] + part * (SHARES[law][k + 1] - SHARES[law][k]))
        peak = peaks[k] + part * (peaks[k + 1] - peaks[k])
    else:  # as near as the law gets
        k = int(np.argmin(np.abs(off)))
        share, peak = float(SHARES[law][k]), peaks[k]
    height = float(wanted.peak_n / peak)
    return {f"{contact}.normal.{k}": height * x for k, x in curve.items()} | {f"{contact}.{law}.{share_name}": share}


def fit_in_the_blow(
    plain: model.Action, law: str, wanted: Mapping[str, Press], time_s: Array, force_n: Array
) -> tuple[model.Action, Blow]:
    """The action whose felts have the peak force and the loss that are wanted, fitted along the last blow's press."""
    given = plain.with_laws(dict.fromkeys(wanted, law))
    along, least = dict(wanted), math.inf
    best = given, play(given, time_s, force_n, tuple(wanted))
    for _ in range(ROUNDS):
        for contact, press in along.items():
            aim = wanted[contact]._replace(time_s=press.time_s, depth_m=press.depth_m)
            given = given.with_values(fit_law(plain, given, contact, law, aim))
        blow = play(given, time_s, force_n, tuple(wanted))
        along = blow.presses
        if set(along) != set(wanted):
            break
        off = max(
            max(abs(press.peak_n / wanted[c].peak_n - 1.0), abs(press.loss_j / wanted[c].loss_j - 1.0))
            for c, press in along.items()
        )
        if off < least:
            best, least = (given, blow), off
        if off < CLOSE:
            break
    return best


def run(
    action: model.Action, time_s: Array, force_n: Array, felts: Mapping[str, Sequence[str]] = FELTS
) -> tuple[list[str], dict[str, Any]]:
    """The blow under each law at equal peak force and loss: lines of text, and the numbers."""
    every = sorted({contact for contacts in felts.values() for contact in contacts})
    base = play(action, time_s, force_n, every)
    rows: list[dict[str, Any]] = []

    def add(group: str, law: str, first: str, played: model.Action, blow: Blow) -> None:
        press = blow.presses[first]
        share = math.nan if law == "hunt-crossley" else played[f"{first}.{law}.{NUMBERS[law][0]}"]
        rows.append({"felts": group, "law": law, "strike_m_per_s": blow.measures.strike_m_per_s,
                     "check_mm": 1e3 * blow.measures.hold_m, "held": blow.measures.held, "peak_n": press.peak_n,
                     "loss_mj": 1e3 * press.loss_j, "share": share,
                     "height": played[f"{first}.normal.c"] / action[f"{first}.normal.c"]})  # fmt: skip

    for group, contacts in felts.items():
        wanted = {c: base.presses[c] for c in contacts if c in base.presses}
        if not wanted:
            continue
        first = next(iter(wanted))
        add(group, "hunt-crossley", first, action, base)
        for law in NUMBERS:
            add(group, law, first, *fit_in_the_blow(action, law, wanted, time_s, force_n))
    lines = [
        "Felt: each law with equal peak force and equal loss of the felt (of all three, the first); share: fitted",
        "epsilon or beta, height: of the slow curve",
        f"{'felts':<12}{'law':<15}{'strike m/s':>11}{'check mm':>10}{'peak N':>8}{'loss mJ':>9}{'share':>8}"
        f"{'height':>8}",
    ]
    for row in rows:
        numbers = f"{row['share']:>8.3f}{row['height']:>8.3f}" if row["law"] != "hunt-crossley" else f"{'-':>8}{'-':>8}"
        lines.append(f"{row['felts']:<12}{row['law']:<15}{row['strike_m_per_s']:>11.3f}{row['check_mm']:>10.2f}"
                     f"{row['peak_n']:>8.1f}{row['loss_mj']:>9.2f}{numbers}")  # fmt: skip
    return lines, {"rows": rows}
