"""Programs of the observables: forces and motion of contacts, tips and bodies at a single state.

Forces are in N, powers in W; world frame: x right, y up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.codegen.observable_columns import (
    BODY,
    CONTACT,
    DEPTH,
    FELT,
    FRICTION,
    HELD,
    NORMAL,
    NX,
    NY,
    RATE,
    RUBBED,
    SLIDE,
    TIP,
    TIP_DEPTH,
    TIP_FORCE,
    TIP_LOST,
    X,
    Y,
)
from model.compiler.expressions import ONE, ZERO, Expression, read, total, value_of, where
from model.compiler.programs import Accumulate, Assign, If, Program, Statement, slot, variable
from model.elements.bodies import solve_mass_matrix
from model.elements.contacts import Contact
from model.elements.drives import Drives
from model.elements.kinematics import Kinematics, State
from model.elements.scene import Elements
from model.elements.strings import StringContact
from model.elements.structure import Structure
from model.kernels.layout import FORCE_DOWN, GRAVITY, MASS, Tables


class ObservablePrograms:
    """Programs of the kernels named above, of a structure.

    Parameters
    ----------
    tables : structure of a scene; all its coordinates are looked at alike, prescribed or not
    """

    def __init__(self, tables: Tables) -> None:
        self._prescribed = bool(tables.prescribed.any())
        s = self._s = Structure(tables._replace(prescribed=np.zeros_like(tables.prescribed)))
        n, count = len(s.bodies), len(s.pin)
        q, v = ([read("x", start + i) for i in range(n)] for start in (0, n))
        self._memory = 2 * n
        first = self._memory + len(s.memory)
        q += [read("x", first + k) for k in range(count)]
        v += [read("x", first + count + k) for k in range(count)]
        z = [read("x", self._memory + m) for m in range(len(s.memory))]
        # what holds a motion is found as the input that gives its acceleration
        self._e = Elements(s, State(q, v, z, ZERO if self._prescribed else read("u", 0)), "x", self._memory)

    def _program(self, statements: list[Statement]) -> Program:
        return Program(dict.fromkeys(("x", "u", "p", "y"), "array"), statements)

    def _contacts(self) -> list[Contact]:
        return [self._e.contact(c) for c in range(len(self._s.contact))]

    def contacts(self) -> Program:
        """Program that writes depth, forces, losses, … of each contact to ``y``: a row of columns `DEPTH` to `FELT` for
        each, one after the other."""
        out = self._e.string_seen()
        for c, contact in enumerate(self._contacts()):
            depth, (nx, ny) = contact.gap
            rate, slide = contact.relative_speeds
            px, py = contact.point(where(depth > 0.0, depth, 0.0))
            row = {DEPTH: depth, RATE: rate, NX: nx, NY: ny, X: px, Y: py}
            out += [Assign(slot("y", CONTACT * c + k), e) for k, e in row.items()]
            mu = ZERO if isinstance(contact, StringContact) else contact.coefficient()
            pressing, force = contact.felt
            pressed = [
                Assign(slot("y", CONTACT * c + k), e)
                for k, e in {NORMAL: force, FRICTION: -(mu * force), RUBBED: mu * force * slide}.items()
            ]
            touch: list[Statement] = [Assign(slot("y", CONTACT * c + SLIDE), slide), If(pressing, list(pressed))]
            out.append(If(contact.touches, touch))
            out += contact.energy(f" of {c}")
            out.append(Assign(slot("y", CONTACT * c + FELT), value_of(f"felt of {c}") + value_of(f"rail of {c}")))
        return self._program(out)

    def tips(self) -> Program:
        """Program that writes depth (m), force (N) and lost power (W) of each tip to ``y``, in columns `TIP_DEPTH`,
        `TIP_FORCE` and `TIP_LOST` of its row."""
        out: list[Statement] = []
        for k, tip in enumerate(self._e.tips):
            pressing, force = tip.felt
            put = [Assign(slot("y", TIP * k + TIP_FORCE), force)]
            out += [Assign(slot("y", TIP * k + TIP_DEPTH), tip.depth), If((tip.depth > 0.0) & pressing, list(put))]
            out += [*tip.energy(f" of tip {k}"), Assign(slot("y", TIP * k + TIP_LOST), value_of(f"felt of tip {k}"))]
        return self._program(out)

    def bodies(self) -> Program:
        """Program that writes motion, joint forces and losses of each body to ``y``: a row of columns `PIVOT_X` to
        `HELD` for each, one after the other."""
        s, e = self._s, self._e
        out = e.string_seen()
        out += e.contactless_forces()
        for c, contact in enumerate(self._contacts()):
            pressing, force = contact.felt
            mu = ZERO if isinstance(contact, StringContact) else contact.coefficient()
            pushes = [Accumulate(variable(f"f{k}"), p) for k, p in contact.push(force, mu).items()]
            world = contact.world(force, mu)
            a, b, _, _ = s.contact[c]
            on = [(body, sign) for body, sign in ((a, 1.0), (b, -1.0)) if body >= 0]
            loads = [
                Accumulate(variable(f"{axis}{body}"), sign * world[k])
                for body, sign in on
                for k, axis in enumerate("xy")
            ]
            out.append(If(contact.touches, [If(pressing, [*pushes, *loads])]))
        for which, tip in enumerate(e.tips):
            out += tip.forces()
            pressing, force = tip.felt
            a, b = s.probe[which]
            loads = [Accumulate(variable(f"y{a}"), force), Accumulate(variable(f"y{b}"), -force)]
            out.append(If((tip.depth > 0.0) & pressing, list(loads)))
        forces = {i: value_of(f"f{i}") for i in range(s.n)}
        acceleration, held = solve_mass_matrix(e.bodies.mass, forces), e.state.u
        if self._prescribed:
            driven = Drives(s, Kinematics(s, replace(e.state, u=ONE)))
            push = driven.pushes[0]
            eased = solve_mass_matrix(e.bodies.mass, {i: push.get(i, ZERO) for i in range(s.n)})
            ahead, gained = (total(p * a[i] for i, p in push.items()) for a in (acceleration, eased))
            out += [Assign(variable("held"), (read("u", 1) - driven.own_rates()[0] - ahead) / gained)]
            held = value_of("held")
            acceleration = {i: a + held * eased[i] for i, a in acceleration.items()}
        out += [Accumulate(variable(f"y{body}"), -held) for kind, body in s.drive if kind == FORCE_DOWN]
        out += [Assign(variable(f"a{i}"), a) for i, a in acceleration.items()]
        rates = [value_of(f"a{i}") for i in range(s.n)]
        joint: dict[int, tuple[Expression, Expression]] = {}
        for i in reversed(s.order()):
            (vx, vy), (ax, ay) = e.bodies.velocity(i), e.bodies.acceleration(i, rates)
            mass = s.body(i, MASS)
            own = (mass * ax - value_of(f"x{i}"), mass * (ay + read("p", GRAVITY)) - value_of(f"y{i}"))
            children = [joint[k] for k, w in enumerate(s.parent) if w == i]
            joint[i] = (own[0] + total(f[0] for f in children), own[1] + total(f[1] for f in children))
            turned = total(rates[k] for k in e.k.turns(i)) if i not in s.guided else ZERO
            braked = e.bodies.joint_friction()[i] * e.state.v[i] + e.damping_power(i)
            angle = total(e.state.q[k] for k in e.k.turns(i)) if i not in s.guided else ZERO
            (x, y), (cx, cy) = e.k.pose[i].pivot, e.bodies.centre(i)
            row = (x, y, angle, cx, cy, e.k.pose[i].turning, turned, vx, vy, ax, ay, *joint[i], braked, rates[i])
            out += [Assign(slot("y", BODY * i + k), value) for k, value in enumerate(row)]
        out += [Assign(slot("y", BODY * i + HELD), held) for _, i in s.drive if self._prescribed]
        return self._program(out)
