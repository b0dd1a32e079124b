"""How near a blow is to what its operations cost on this processor.

The kernels' code is given a counter in each of its blocks, so that a run says which operations it executes; a row of
eight counts as the two halves that it is taken in. Two floors of an attempt at a step follow, in the same run as its
time: *units*, the same mixture in twelve chains that do not wait for each other, without branches; *waiting*, steps of
the run called again and again, each until the processor has learnt its branches and holds its numbers: the same
operations in the same order, each waiting for those before it, and nothing else. Processor time, the least of turns.
"""

from __future__ import annotations

import ctypes
import re
from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from llvmlite import binding
from numpy.typing import NDArray

import model
from benchmarks.peers.compiled import force_table
from benchmarks.runner import Run, Table, in_turns
from model.derived import load
from model.integrators.methods import DEFAULT_METHOD, METHODS
from model.integrators.step_control import allow
from model.kernels import workspace as W
from model.kernels.compile import kernel
from model.kernels.kernel_value import Kernel
from model.kernels.signatures import STEP, StepKernels
from model.scene.build import Scene
from model.simulation.run import Simulation, State

KINDS = {
    "sums": r"= (?:fadd|fsub|fneg)", "products": "= fmul", "fused": r"llvm\.fmuladd", "quotients": "= fdiv",
    "roots": r"llvm\.sqrt", "choices": r"= (?:select|fcmp)", "loads": "= load", "stores": r"^\s+store",
}  # fmt: skip
ROW = re.compile(r"<(\d+) x double>")
CHAINS, LOOPS, EVERY, MOST = 12, 10, 40, 1.5
DO = {
    "sums": "%{new} = fadd {t} %{old}, {c}", "products": "%{new} = fmul {t} %{old}, {c}",
    "fused": "%{new} = call {t} @llvm.fmuladd.{s}({t} %{old}, {t} {c}, {t} {c})",
    "quotients": "%{new} = fdiv {t} %{old}, {c}", "roots": "%{new} = call {t} @llvm.sqrt.{s}({t} %{old})",
    "choices": "%{new}.is = fcmp olt {t} %{old}, {c}\n  %{new} = select {k} %{new}.is, {t} {c}, {t} %{old}",
    "loads": "%{new} = load volatile {t}, ptr %at{place}, align 8",
    "stores": "store volatile {t} %{old}, ptr %to{place}, align 8",
}  # fmt: skip


def _engine(code: str) -> Any:
    machine = load._target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(code), machine)
    engine.finalize_object()
    return engine


def counted(scene: Scene) -> tuple[StepKernels, Callable[[], Counter[str]]]:
    """Kernels of a scene that count, and what they executed since the last time that was asked."""
    out, kinds, after_phi = [], [Counter[str]()], False
    for line in str(load.linked(scene.tables, STEP, 1, load._target_machine())).splitlines():
        if after_phi and " = phi " not in line:
            k, after_phi = len(kinds) - 1, False
            at = f"getelementptr (i64, ptr @executed, i64 {k})"
            out += [f"  %n{k} = load i64, ptr {at}", f"  %m{k} = add i64 %n{k}, 1", f"  store i64 %m{k}, ptr {at}"]
        out.append(line)
        if re.match(r'[\w."-]+:', line):
            kinds.append(Counter())
            after_phi = True
        for name, pattern in KINDS.items():
            if re.search(pattern, line) and ("double" in line or " i1 " in line):
                row = ROW.search(line)
                kinds[-1][name] += max(1, int(row[1]) // 4) if row else 1
    engine = _engine("\n".join(out) + f"\n@executed = global [{len(kinds)} x i64] zeroinitializer\n")
    array = (ctypes.c_int64 * len(kinds)).from_address(engine.get_global_value_address("executed"))
    made = {name: Kernel(engine.get_function_address(name), of, engine) for name, of in STEP.items()}

    def taken() -> Counter[str]:
        total: Counter[str] = Counter()
        for k, one in enumerate(kinds):
            for name, count in one.items():
                total[name] += count * array[k]
            array[k] = 0
        return total

    return StepKernels(**made, energy=made["linearise"]), taken


@cache
def mixture(executed: tuple[tuple[str, float], ...], lanes: int = 1) -> Callable[[int], None]:
    """A function that does so many operations of each kind a number of times, in chains that do not wait."""
    kind, short, truth = (
        ("double", "f64", "i1") if lanes == 1 else (f"<{lanes} x double>", f"v{lanes}f64", f"<{lanes} x i1>")
    )
    one = "1.0" if lanes == 1 else "<" + ", ".join(["double 1.0"] * lanes) + ">"
    order = sorted((j / max(1, n), name) for name, total in executed for n in [round(total / LOOPS)] for j in range(n))
    now, lines = [f"x{i}" for i in range(CHAINS)], []
    for k, (_, name) in enumerate(order):
        i, place = k % CHAINS, k % 16
        lines.append("  " + DO[name].format(new=f"v{k}", old=now[i], t=kind, s=short, k=truth, c=one, place=place))
        now[i] = f"v{k}" if name not in ("stores", "loads") else now[i]
    places = "\n".join(
        f"  %{name}{k} = getelementptr {kind}, ptr %w, i64 {k + shift}"
        for name, shift in (("at", 0), ("to", 16)) for k in range(16)
    )  # fmt: skip
    phis = "\n".join(f"  %x{i} = phi {kind} [ {one}, %entry ], [ %{v}, %loop ]" for i, v in enumerate(now))
    ends = "\n".join(f"  store volatile {kind} %{v}, ptr %to{i}, align 8" for i, v in enumerate(now))
    engine = _engine(
        f"declare {kind} @llvm.fmuladd.{short}({kind}, {kind}, {kind})\ndeclare {kind} @llvm.sqrt.{short}({kind})\n"
        f"define void @mix(ptr %w, i64 %n) {{\nentry:\n{places}\n  br label %loop\nloop:\n{phis}\n"
        "  %k = phi i64 [ 0, %entry ], [ %k1, %loop ]\n" + "\n".join(lines) + "\n  %k1 = add i64 %k, 1\n"
        f"  %more = icmp slt i64 %k1, %n\n  br i1 %more, label %loop, label %done\ndone:\n{ends}\n  ret void\n}}\n"
    )  # fmt: skip
    space = np.ones(64 * lanes)
    mix = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)(engine.get_function_address("mix"))

    def run(times: int, engine: Any = engine) -> None:
        mix(space.ctypes.data, LOOPS * times)

    return run


@kernel
def again(step, p, u, kernels, method, times, w):  # type: ignore[no-untyped-def]
    """An attempt at a step from the state in ``w``, so many times."""
    linearise, prepare, skip, stage, fit, end, _, _, _ = kernels
    a, c, b, _, d, _, gamma, _ = method
    for _ in range(times):
        linearise(w, p, u)
        w[W.FITTED] = step
        fit(w, p)
        prepare(w, gamma * step)
        allow(w, step)
        mask = skip(w, p)
        for m in range(b.shape[0]):
            stage(w, p, a, c, m, gamma * step, 1.0 / step, u, 0.0 * d[m], mask)
        end(w, b, b.shape[0], 0)


def attempts(blow: str, tolerance: float, turns: int) -> dict[str, Any]:
    """Attempts of a run, µs of one, its floors by units, by waiting and in lanes, operations executed in one."""
    action, (t, f), method = model.load_action(), force_table(blow), METHODS[DEFAULT_METHOD]
    scene, rest = model.build_scene(action), model.rest_state(action)
    one = Simulation(scene, State(float(t[0]), rest.angle_rad.copy(), np.zeros(scene.size)), tolerance)
    plan = one.plan(float(t[-1]), t, f)
    n, kernels = scene.size, load.kernels_of(scene.tables)
    steps = np.zeros((200_000, 2 + 2 * n * (2 + len(method.dense))))

    def run(kernels: StepKernels, kept: NDArray[np.float64]) -> None:
        span = plan.span._replace(angle=plan.span.angle.copy(), speed=plan.span.speed.copy())
        plan.account.counters[:] = 0
        out = plan.out._replace(steps=kept)
        method.loop(span, plan.drive, out, plan.scene, kernels, method.coefficients, plan.limits, plan.account)

    counting, taken = counted(scene)
    run(counting, steps)
    count = int(plan.account.counters[0] + plan.account.counters[1])
    run(counting, np.empty((0, 0)))
    taken(), run(counting, np.empty((0, 0)))
    executed = {name: total / count for name, total in taken().items()}
    rows = steps[: np.count_nonzero(steps[:, 1])][::EVERY]
    states = [np.zeros(W.SIZE) for _ in rows]
    for w, row in zip(states, rows, strict=True):
        w[W.ANGLE_LIMIT], w[W.SPEED_LIMIT] = plan.limits.angle, plan.limits.speed
        w[W.Q : W.Q + n], w[W.V : W.V + n] = row[2 : 2 + n], row[2 + n : 2 + 2 * n]
    force = np.interp(rows[:, 0], t, f)
    mixed = tuple(executed.items())

    def waited(times: int) -> None:
        for w, row, u in zip(states, rows, force, strict=True):
            again(row[1], scene.vector, u, kernels, method.coefficients, times, w)

    jobs: dict[str, Callable[[], None]] = {
        "run": lambda: run(kernels, np.empty((0, 0))), "units": lambda: mixture(mixed)(count),
        "few": lambda: waited(5), "many": lambda: waited(45), "lanes": lambda: mixture(mixed, 8)(count),
    }  # fmt: skip
    spent = {name: 1e6 * seconds.min() for name, seconds in in_turns(jobs, turns).items()}
    waiting = (spent["many"] - spent["few"]) / (40 * len(rows))
    found = {"attempts": count, "run": spent["run"] / count, "units": spent["units"] / count, "waiting": waiting}
    return found | {"lanes": spent["lanes"] / count / 8, "executed": executed}


def main(run: Run) -> bool:
    """Print; whether a run takes at most `MOST` times the floor by waiting, and more than that by units."""
    table = Table("blow:10s", "attempts:d", "us of one:.2f", "waiting:.2f", "of it:.2f", "units:.2f", "of it:.2f", *(
        f"{name}:.0f" for name in KINDS
    ))  # fmt: skip
    good, said = True, list[str]()
    for blow in run.blow:
        x = attempts(blow, run.tolerance, run.turns)
        ratios = [x["run"] / x[name] for name in ("waiting", "units")]
        table.row(blow, x["attempts"], x["run"], x["waiting"], ratios[0], x["units"], ratios[1], *(
            x["executed"].get(name, 0.0) for name in KINDS
        ))  # fmt: skip
        good &= ratios[0] <= MOST and ratios[1] > 1.0
        said.append(f"{blow} {ratios[0]:.2f} and {ratios[1]:.2f} ({x['run']:.2f} µs)")
    run.figure("floor", "; ".join(said))
    return good
