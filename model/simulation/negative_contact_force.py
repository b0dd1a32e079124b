"""Errors for felt of an added law whose force is negative: which contact, by how much, what to write."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.codegen.evaluate_observables import contacts_at
from model.codegen.load import load_kernels
from model.codegen.observable_columns import DEPTH, NORMAL, RATE
from model.compiler.expressions import argument, clear_cache, constant
from model.elements.laws.check_law import compile_values
from model.elements.laws.felt_law import PULL_N, Felt
from model.elements.structure import Structure
from model.errors import InputError
from model.kernels import layout as L
from model.kernels import workspace as W
from model.scene.build import Scene

Array = NDArray[np.float64]

AHEAD_S = (0.0, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8)
"""Beyond the last state that a run took, in which its shortest steps failed."""
ADVICE = "say in 'force' where it presses, each factor by itself, such as (slow > 0.0) & (factor > 0.0), slow * factor"


def check_pushes(scene: Scene, time_s: Array, contact: Array, memory: Array | None) -> None:
    """Refuse columns (m, c, 11) of `contacts_at` in which felt of an added law pulls."""
    m, c = np.nonzero(np.isnan(contact[:, :, NORMAL]))
    if len(m):
        rows = np.empty((len(contact), 0)) if memory is None else memory
        raise InputError(describe_force(scene, float(time_s[m[0]]), int(c[0]), contact[m[0]], rows[m[0]]))


def describe_force(scene: Scene, time_s: float, c: int, contact: Array, memory: Array) -> str:
    """Sentence on contact ``c`` at ``time_s``: its law's force, N, depth and rate, and that felt never pulls;
    ``contact``: columns (C, 11) of all, ``memory``: internal variables."""
    law = Structure(scene.tables).law(c)
    force = law_force_n(scene, c, contact, memory)
    return (
        f"{scene.contacts[c]}.law {law.name}: force {force:.3g} N at {time_s:.6g} s, allowed from 0: felt never pulls "
        f"(here at depth {1e3 * contact[c, DEPTH]:.3g} mm and rate {contact[c, RATE]:.3g} m/s); {ADVICE}"
    )


def law_force_n(scene: Scene, c: int, contact: Array, memory: Array) -> float:
    """Force (N) of the law of contact ``c``, of either sign, from the columns of all (C, 11) and the internal
    variables; 0 out of contact."""
    s, p = Structure(scene.tables), scene.vector
    law, first = s.law(c), s.offset[1] + L.CONTACT_SIZE * c
    with_numbers = tuple(constant(float(p[n.args[1]])) for n in s.law_numbers(c))
    a, b, c_ = (constant(float(x)) for x in p[first + L.K_A : first + L.K_C + 1])
    z = tuple(constant(float(memory[k])) for k in s.memories(c))
    depth, rate = argument("depth"), argument("rate")
    felt = Felt(depth, rate, z, (a, b, c_), constant(float(p[first + L.DAMP])), with_numbers)
    presses, force = law.force(felt)
    values = compile_values([presses, force])({depth: float(contact[c, DEPTH]), rate: float(contact[c, RATE])})
    found = float(values[force]) if contact[c, DEPTH] > 0.0 and values[presses] else 0.0
    clear_cache()
    return found


def describe_jumps(scene: Scene) -> str:
    """Return a clause that names the laws of a scene that jump with their usual numbers; empty where there is none."""
    s = Structure(scene.tables)
    jumps = [f"{scene.contacts[c]}.law {law.name}: {law.jump}" for c in range(len(s.contact)) if (law := s.law(c)).jump]
    return f"; no step may get across a jump: {'; '.join(jumps)}" if jumps else ""


def describe_pull(scene: Scene, time_s: float, state: tuple[Array, Array, Array], u: float) -> str:
    """Sentence (`describe_force`) on an added law that would pull next at a state (angles, speeds, memory) under input
    ``u``, where a run stopped; empty where that was not why."""
    s = Structure(scene.tables)
    watched = [c for c in range(len(s.contact)) if s.law(c).added]
    if not watched or np.any(scene.tables.prescribed) and len(state[0]) != scene.size:
        return ""
    q, v, memory = state
    w = np.zeros(W.WITH_MEMORY)
    w[W.Q : W.Q + len(q)], w[W.V : W.V + len(v)], w[W.Z : W.Z + len(memory)] = q, v, memory
    load_kernels(scene.tables).linearise(w, scene.vector, u)
    n = len(scene.tables.parent)
    whole, speed = w[W.Q : W.Q + n].copy(), w[W.V : W.V + n].copy()
    gain = np.nan_to_num(w[W.ACC : W.ACC + n])
    for ahead in AHEAD_S:
        angle, rate = whole + ahead * speed, speed + ahead * gain
        contact = contacts_at(scene.tables, scene.vector, angle[None], rate[None], memory[None])[0]
        for c in watched:
            if np.isnan(contact[c, NORMAL]) and law_force_n(scene, c, contact, memory) < -PULL_N:
                return describe_force(scene, time_s, c, contact, memory)
    return ""
