"""The action's equations written out as straight-line source, for solvers that are not ours.

Takes an `Action` and returns the text of ``rhs`` with every parameter a literal number and every loop unrolled,
the fastest form a compiled right-hand side can take. Nothing from ``model.kernels`` is used, so that a reference made
with it also checks those kernels.

An ``if`` around each contact lets an open one cost only its gap.
Equations: thesis Chapter 2 and docs/decisions; planar bodies, at most one parent each.
"""

from __future__ import annotations

import math
from typing import Any

from model import BODIES, Action

N = len(BODIES)


class Emitter:
    """Collects the lines of one right-hand side."""

    def __init__(self, action: Action) -> None:
        self.action = action
        self.lines: list[str] = []
        self.depth = 1
        self.parent = [action.structure[f"{b}.parent"] for b in BODIES]

    def add(self, text: str) -> None:
        """Write a line at the current indentation."""
        self.lines.append("    " * self.depth + text)

    def value(self, path: str) -> str:
        """A parameter as a literal number."""
        return f"({self.action[path]!r})"

    def lineage(self, body: str) -> list[int]:
        """Coordinates that move a body: its own and its parents'."""
        out = []
        while body != "ground":
            out.append(BODIES.index(body))
            body = self.parent[out[-1]]
        return out

    def place(self, name: str, body: str, x: float, y: float) -> None:
        """World position ``{name}x``, ``{name}y`` of a point given in the frame of ``body``."""
        pivot_x, pivot_y = ("", "") if body == "ground" else (f"p{axis}{BODIES.index(body)} + " for axis in "xy")
        along_x, along_y = self.turned(body, x, y)
        self.add(f"{name}x = {pivot_x}{along_x}")
        self.add(f"{name}y = {pivot_y}{along_y}")

    def turned(self, body: str, x: float, y: float) -> tuple[str, str]:
        """World components of (x, y) in the frame of ``body``."""
        if body == "ground":
            return f"{x!r}", f"{y!r}"
        i = BODIES.index(body)
        return f"c{i} * ({x!r}) - s{i} * ({y!r})", f"s{i} * ({x!r}) + c{i} * ({y!r})"

    def local(self, path: str) -> tuple[float, float]:
        """A point or direction as given, in its body's frame."""
        return float(self.action[f"{path}.x"]), float(self.action[f"{path}.y"])

    def kinematics(self) -> None:
        """Absolute angle ``a``, speed ``w``, cosine, sine and pivot of each body."""
        for i, body in enumerate(BODIES):
            up = self.parent[i]
            x, y = self.local(f"{body}.pivot")
            if up == "ground":
                self.add(f"a{i} = y[{i}]")
                self.add(f"w{i} = y[{N + i}]")
            else:
                k = BODIES.index(up)
                self.add(f"a{i} = a{k} + y[{i}]")
                self.add(f"w{i} = w{k} + y[{N + i}]")
            self.add(f"c{i} = cos(a{i})")
            self.add(f"s{i} = sin(a{i})")
            self.place("p", up, x, y)
            self.add(f"px{i} = px")
            self.add(f"py{i} = py")

    def curve(self, s: str, scale: str, path: str) -> str:
        """Regularised friction curve of eqs 2.10 and 2.12; fills ``z``."""
        a, b1, b2 = (self.action[f"{path}.{k}"] for k in ("A", "B1", "B2"))
        self.add(f"z = ({s}) * (1.0 / {self.value(scale)})")
        extra = f" + ({b1!r}) * z / (1.0 + ({b2!r}) * z * z * z * z)" if b1 != 0 else ""
        return f"({a!r}) * (tanh(z){extra})"

    def inertia(self) -> None:
        """Mass matrix entries ``m{i}_{j}`` and all forces except contact forces in ``f{i}``."""
        g = self.value("gravity.g")
        terms: dict[tuple[int, int], list[str]] = {}
        force: list[list[str]] = [[] for _ in range(N)]
        for i, body in enumerate(BODIES):
            chain, up = self.lineage(body), self.parent[i]
            m, inertia = self.value(f"{body}.mass"), self.value(f"{body}.inertia")
            self.place("gc", body, *self.local(f"{body}.center_of_mass"))
            for j in chain:
                self.add(f"rx{i}_{j} = gcx - px{j}")
                self.add(f"ry{i}_{j} = gcy - py{j}")
            ax, ay = f"-w{i} * w{i} * rx{i}_{i}", f"-w{i} * w{i} * ry{i}_{i}"
            if up != "ground":
                k = BODIES.index(up)
                ax += f" - w{k} * w{k} * (px{i} - px{k})"
                ay += f" - w{k} * w{k} * (py{i} - py{k})"
            self.add(f"fx{i} = -{m} * ({ax})")
            self.add(f"fy{i} = -{m} * ({g} + ({ay}))")
            for j in chain:
                force[j].append(f"rx{i}_{j} * fy{i} - ry{i}_{j} * fx{i}")
                for k in chain:
                    if j <= k:
                        dot = f"(rx{i}_{j} * rx{i}_{k} + ry{i}_{j} * ry{i}_{k})"
                        terms.setdefault((j, k), []).append(f"{m} * {dot} + {inertia}")
        for i, body in enumerate(BODIES):
            joint = self.curve(f"y[{N + i}]", "friction_threshold.omega_t", f"{body}.joint_friction")
            self.add(f"f{i} = {' + '.join(force[i])} - {joint}")
        for body in ("jack", "repetition"):
            i, s = BODIES.index(body), f"{body}_spring"
            k, zero = self.value(f"{s}.stiffness"), self.value(f"{s}.angle")
            self.add(f"f{i} += {self.value(f'{s}.torque')} - {k} * (y[{i}] - {zero})")
        self.place("d", "key", *self.local("drive.point"))
        self.add("f0 -= (dx - px0) * u")
        self.mass = terms
        for (j, k), parts in terms.items():
            self.add(f"m{j}_{k} = {' + '.join(parts)}")

    def gap(self, path: str, first: str, second: str) -> None:
        """Penetration ``x`` and unit normal ``nx, ny`` from second to first."""
        a, r = self.action, float(self.action[f"{path}.first.radius"])
        self.place("c", first, *self.local(f"{path}.first"))
        self.place("o", second, *self.local(f"{path}.second"))
        self.add("ux = cx - ox")
        self.add("uy = cy - oy")
        shape = a.structure[f"{path}.second.shape"]
        if shape == "line":
            self.direction("n", second, *self.local(f"{path}.second.normal"))
            self.add(f"x = {r!r} - (ux * nx + uy * ny)")
            return
        reach = r + float(a[f"{path}.second.radius"])
        self.add("d = sqrt(ux * ux + uy * uy)")
        if shape == "circle":
            self.add("nx = ux / d")
            self.add("ny = uy / d")
            self.add(f"x = {reach!r} - d")
            return
        for name, end in (("b", "start"), ("e", "end")):
            angle = float(a[f"{path}.second.arc_{end}"])
            self.direction(name, second, math.cos(angle), math.sin(angle))
            self.add(f"h{name} = ux * {name}x + uy * {name}y")
        self.add("before = bx * uy - by * ux < 0")
        self.add("after = ex * uy - ey * ux > 0")
        self.add(f"if before and (hb >= he or not after): nx = bx; ny = by; x = {reach!r} - hb")
        self.add(f"elif after: nx = ex; ny = ey; x = {reach!r} - he")
        self.add(f"else: nx = ux / d; ny = uy / d; x = {reach!r} - d")

    def direction(self, name: str, body: str, x: float, y: float) -> None:
        """World components of a unit vector along (x, y) in the frame of ``body``."""
        size = math.hypot(x, y)
        for axis, component in zip("xy", self.turned(body, x / size, y / size), strict=True):
            self.add(f"{name}{axis} = {component}")

    def contact(self, path: str) -> None:
        """Add one contact's normal and friction force to ``f{i}``."""
        a = self.action
        first, second = a.structure[f"{path}.first.body"], a.structure[f"{path}.second.body"]
        self.gap(path, first, second)
        self.add("if x > 0.0:")
        self.depth += 1
        r = float(a[f"{path}.first.radius"])
        self.add(f"hx = cx - ({r!r} - 0.5 * x) * nx")
        self.add(f"hy = cy - ({r!r} - 0.5 * x) * ny")
        one, two = self.lineage(first), self.lineage(second)
        moving = [(i, 1) for i in one if i not in two] + [(i, -1) for i in two if i not in one]
        signs = {1: "+", -1: "-"}
        self.add("vx = " + " ".join(f"{signs[-s]} y[{N + i}] * (hy - py{i})" for i, s in moving))
        self.add("vy = " + " ".join(f"{signs[s]} y[{N + i}] * (hx - px{i})" for i, s in moving))
        ka, kb, kc, damping = (self.value(f"{path}.normal.{k}") for k in ("a", "b", "c", "D"))
        self.add(f"fn = (({ka} * x + {kb}) * x + {kc}) * x * (1.0 - {damping} * (nx * vx + ny * vy))")
        self.add("if fn > 0.0:")
        self.depth += 1
        curve = self.curve("nx * vy - ny * vx", "friction_threshold.v_t", f"{path}.friction")
        self.add(f"ft = -fn * ({curve})")
        self.add("gx = fn * nx - ft * ny")
        self.add("gy = fn * ny + ft * nx")
        for i, s in moving:
            self.add(f"f{i} {signs[s]}= (hx - px{i}) * gy - (hy - py{i}) * gx")
        self.depth -= 2

    def solve(self) -> None:
        """Accelerations: children eliminated into their single parent."""
        children = {i: BODIES.index(up) for i, up in enumerate(self.parent) if up != "ground"}
        pair = {i: f"m{min(i, k)}_{max(i, k)}" for i, k in children.items()}
        for i in range(N):
            if i not in children:
                own = [c for c, k in children.items() if k == i]
                f = "".join(f" - {pair[c]} / m{c}_{c} * f{c}" for c in own)
                m = "".join(f" - {pair[c]} * {pair[c]} / m{c}_{c}" for c in own)
                self.add(f"q{i} = (f{i}{f}) / (m{i}_{i}{m})")
        for c, k in children.items():
            self.add(f"q{c} = (f{c} - {pair[c]} * q{k}) / m{c}_{c}")


def source(action: Action) -> str:
    """Text of ``accelerations(y, u)``: y = 5 angles and 5 speeds, u the key force (N); gives 5 accelerations."""
    out = Emitter(action)
    out.kinematics()
    out.inertia()
    for i in range(1, 14):
        out.contact(f"contact{i:02d}")
    out.solve()
    return "\n".join(["def accelerations(y, u):", *out.lines, f"    return {', '.join(f'q{i}' for i in range(N))}"])


def accelerations(action: Action) -> Any:
    """The function itself."""
    space: dict[str, Any] = {k: getattr(math, k) for k in ("sin", "cos", "tanh", "sqrt")}
    exec(compile(source(action), "<equations of the action>", "exec"), space)
    return space["accelerations"]
