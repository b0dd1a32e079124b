"""Table *inside*: forces, ways and energies inside the model's scene, made where a report is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pandas as pd

import model
from model.inside.labels import contact_label
from model.parameters.effects import KEY_LIFT, SHANK
from validation.conventions import Array
from validation.measurement.measure_session import select_representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import JointDraw, drawn_action, drawn_run, joint_draws, session_seed
from validation.prediction.many_runs import run_many
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession
from validation.tables.comparison import Comparison
from validation.tables.table import Column, Page, Table
from validation.verdict.error_draws import OWN_DRAWS

COLUMNS = (
    Column("part", "", "Contact, joint, or what an energy or a way is of", str, head="part"),
    Column("kind", "", "energy, contact, joint or way", str),
    Column("trial", "", "Trial whose force drives the model", int),
    Column("largest_n", "N", "Largest force: of a contact along its normal, of a joint on its body",
           head="largest force", u="u_largest_n"),
    Column("u_largest_n", "N", "Its standard uncertainty, from the draws; of contacts only"),
    Column("at_s", "s", "When the force, or the way, is largest", head="at", digits=4),
    Column("largest_m", "m", "Largest depth of a contact's felt, way of a joint that gives, of the string, of the key "
           "above its rail", head="depth, way"),
    Column("slid_m", "m", "Way rubbed in a contact, both directions added", head="rubbed"),
    Column("energy_j", "J", "Energy: of its name, or lost in a contact, or in a joint by its friction and bushing",
           head="energy", u="u_energy_j"),
    Column("u_energy_j", "J", "Its standard uncertainty, from the draws; of whole energies only"),
    Column("friction_j", "J", "Part of it lost by friction; of contacts only", head="by friction"),
    Column("felt_j", "J", "Part of it lost in the felt; of contacts only", head="in felt"),
    Column("draws", "", "Draws of force and parameters that could be run; 0 without a budget", int),
)  # fmt: skip
ENERGIES = {
    "work_in": "work of the force on the key",
    "stored_change": "stored in the action, change since rest",
    "lost_in_felt": "lost in felt",
    "lost_in_contact_friction": "lost by friction of contacts",
    "lost_in_joint_friction": "lost by friction of joints",
    "lost_in_rail": "lost at the balance rail",
    "lost_in_shank": "lost in the shank",
    "lost_in_pins": "lost in bushings of joints that give",
    "lost_in_string": "lost in the string",
    "residual": "not accounted for: error of the integration",
}


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Rows of forces, distances and energies in the model, for the sound trial of median peak force."""
    return inside_rows(comparison.sound, comparison.tested, is_drawn=comparison.options.budget)


def inside_rows(predicted: PredictedSession, tested: ModelUnderTest, *, is_drawn: bool) -> list[dict[str, Any]]:
    """Rows by column of the largest loads, deformations and energies in the predicted blow of the trial of median peak
    force, with u where ``is_drawn``; empty for a stand-in or where the key drives. Simulates, unless stored.

    Standard uncertainties, where they are drawn, are those of `OWN_DRAWS` draws of force and parameters
    (`validation.prediction.joint_draws`).
    """
    if not tested.own_model or any(m.driven_by_key for m in predicted.trials):
        return []
    m = select_representative(predicted.trials)
    draws = joint_draws(tested.action, session_seed(predicted.trials), OWN_DRAWS, parameters=True) if is_drawn else []
    found: list[dict[str, Any]] = tested.store.value(
        "inside the action",
        (tested.identity, m.number, m.time_s, m.force, draws),
        lambda: list(_make_rows(tested, m, draws)),
    )
    return found


def _make_rows(tested: ModelUnderTest, m: MeasuredTrial, draws: Sequence[JointDraw]) -> Iterator[dict[str, Any]]:
    """Yield rows by column of the largest loads, deformations and energies of a trial's predicted blow, with standard
    uncertainties by simulating it in each of the ``draws`` (NaN without any)."""
    force, at = m.force, m.force.time_s  # the force bends there, and integrals stop at bends and outputs
    blow = tested.simulate(
        tested.action, force.time_s, force.force_n, tolerance=tested.tolerance, output_time_s=at,
        initial=tested.load(force.preload_n).rest, inside=True, energy=True,
    )  # fmt: skip
    parts = list(_list_parts(tested.action, blow))
    del blow  # half of what a report of many trials would hold beside them
    actions = [drawn_action(tested, m, draw) for draw in draws]
    runs = [None if one is None else drawn_run(tested, m, one, at) for one in actions]
    asked = [None if run is None else replace(run, outputs=("contact_forces", "energy")) for run in runs]
    drawn = [sizes for sizes in run_many(tested, asked, lambda _, solution: _sizes(solution)) if sizes is not None]
    u = pd.DataFrame(drawn).std()
    for name, row in parts:
        doubt = "u_energy_j" if row["kind"] == "energy" else "u_largest_n"
        yield row | {"trial": m.number, "draws": len(drawn), doubt: float(u.get(name, np.nan))}


def _sizes(solution: model.Solution) -> dict[str, float]:
    """Largest normal force (N) of each contact, and the energies (J)."""
    assert solution.contact_normal_n is not None and solution.energy is not None
    forces = solution.contact_normal_n.max(axis=0, initial=0.0)
    return dict(zip(solution.contacts, map(float, forces), strict=True)) | _energies(solution.energy)


def _energies(audit: model.EnergyAudit) -> dict[str, float]:
    return asdict(audit) | {"residual": audit.residual}


def _list_parts(action: model.Action, blow: model.Solution) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and row by column of each energy (J), contact, joint (N, J) and moving part (m) of a blow simulated
    with inner forces and energy."""
    seen, time = blow.inside, blow.time_s
    assert seen is not None and blow.energy is not None
    for name, energy in _energies(blow.energy).items():
        if energy != 0.0:
            yield name, {"kind": "energy", "part": ENERGIES[name], "energy_j": energy}
    for i, name in enumerate(seen.contacts):
        friction, felt = float(seen.rubbed_j[-1, i]), float(seen.felt_j[-1, i])
        row = {
            "kind": "contact",
            "part": contact_label(action, name),
            "largest_n": float(seen.largest_normal_n[i]),
            "at_s": float(time[np.argmax(seen.normal_n[:, i])]) if seen.normal_n[:, i].any() else np.nan,
            "largest_m": max(float(seen.penetration_m[:, i].max()), 0.0),
            "slid_m": float(seen.slid_m[-1, i]),
            "energy_j": friction + felt,
            "friction_j": friction,
            "felt_j": felt,
        }
        yield name, row
    for i, body in enumerate(seen.bodies):
        if body in seen.turning_bodies:
            force = np.hypot(*seen.joint_n[:, i].T)
            place = "bend of the shank" if body == SHANK else f"joint of the {body}"
            # friction, and what its bushing takes where it gives: not told apart
            row = {"kind": "joint", "part": place, "energy_j": float(seen.joint_j[-1, i])}
            if blow.give is not None:
                row["largest_m"] = float(np.hypot(*blow.give.joint_motion(body)[0].T).max())
            yield body, row | {"largest_n": float(force.max()), "at_s": float(time[np.argmax(force)])}
    ways: dict[str, Array] = {} if blow.string is None else {"string where it is struck": blow.string.way_m}
    if KEY_LIFT in blow.bodies:
        ways["key above its balance rail"] = blow.angle_rad[:, blow.bodies.index(KEY_LIFT)]
    for part, way in ways.items():
        k = int(np.argmax(np.abs(way)))
        yield part, {"kind": "way", "part": part, "largest_m": float(abs(way[k])), "at_s": float(time[k])}


NOTES = (
    "The blow that the force of trial {trial} (median peak) makes in the model’s scene: largest forces of contacts "
    "(along the normal) and joints, how deep felt is pressed, what joints and string give way, and where the energy "
    "goes from rest to the end of the record. ±: standard uncertainty from {draws} draws of force and parameters as "
    "declared; none without a budget. It is a prediction: nothing here was measured.",
)
TABLE = Table(
    "inside",
    "energy, contact, joint or way inside the model's scene, in the predicted blow of one trial; in a report only",
    COLUMNS,
    rows,
    (Page("inside", "Forces, ways and energies inside the model, trial {trial}", NOTES),),
    of="report",
)
