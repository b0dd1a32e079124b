"""What would batches on a graphics processor need, and at what rate would they run?

    python -m benchmarks gpu_lanes [--members N]

The kernels of the default scene are written for NVIDIA's instruction set from the same text as for this processor (a
thread is a member), and counted: operations on float64, loads and stores, values alive at once. With the work of a
forte they give bounds of the rate: by the float64 units (a division or root counts `SLOW` operations), and by the
memory, if the workspace of a step is read from there each time. Threads of a warp wait for each other: members that
each take their own steps keep it busy for the mean of their attempts over the largest; members that follow each other
in a lane, as they do here, do not wait. All contacts count as evaluated, for one thread that needs one makes all wait.
Nothing is run on a device.
"""

from __future__ import annotations

import re
import time
from unittest.mock import patch

import numpy as np
from llvmlite import binding

import model
from benchmarks.batches import TOLERANCE, trials, unlike
from benchmarks.runner import Run, Table
from model.derived import load
from model.integrators.methods import METHODS
from model.kernels.workspace import SIZE
from model.scene.build import Scene

TRIPLE, KIND = "nvptx64-nvidia-cuda", "sm_80"
WARP, SLOW = 32, 10
REGISTERS, MOST_REGISTERS = 65536, 255
DEVICES = {
    "A100 SXM": (9.7, 2039.0, 108, 40.0),
    "H100 SXM": (34.0, 3350.0, 132, 50.0),
    "RTX 4090": (1.29, 1008.0, 128, 72.0),
}
"""Float64 outside tensor cores (1e12/s, a fused multiply-add is two), memory (GB/s), multiprocessors, second cache
(MB): NVIDIA's data sheets."""
FLOAT64 = re.compile(r"^\s+(?:@!?%p\d+ )?(add|sub|mul|fma|div|sqrt|neg|abs|min|max|setp|selp)[.\w]*f64\s")
MOVED = re.compile(r"^\s+(?:@!?%p\d+ )?(ld|st)\.b64\s")
NAMED = re.compile(r"%rd\d+")
BEYOND = "define double @__nv_{0}(double %x) {{\n  ret double 0x7FF8000000000000\n}}\n"
"""Cosine and sine beyond 45 degrees, and powers, come from NVIDIA's libdevice; without it they are no number."""


def written(scene: Scene) -> str:
    """The kernels of a scene in NVIDIA's instruction set."""
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    with patch.object(load, "lanes_pay", lambda: False):
        text = str(load._module(scene.tables, load.STEP, 1))
    for name in ("cos", "sin", "pow"):
        used = f"llvm.{name}.f64" in text
        text = re.sub(rf'declare double @"llvm\.{name}\.f64".*\n', "", text).replace(f"llvm.{name}.f64", f"__nv_{name}")
        text += BEYOND.format(name) if used else ""
    machine = binding.Target.from_triple(TRIPLE).create_target_machine(cpu=KIND, opt=3)
    module = binding.parse_assembly(text)
    module.triple, module.data_layout = TRIPLE, str(machine.target_data)
    module.verify()
    passes = binding.create_pass_builder(machine, binding.create_pipeline_tuning_options(speed_level=2))
    passes.getModulePassManager().run(module, passes)
    return str(machine.emit_assembly(module))


def counted(code: str) -> dict[str, tuple[int, int, int]]:
    """Operations on float64, numbers moved, and most 64-bit values alive at once, of each kernel."""
    out = {}
    for name, body in re.findall(r"^\.visible \.func .*? (\w+)\(\n(.*?)^\}", code, re.DOTALL | re.MULTILINE):
        lines = body.splitlines()
        kinds = [match.group(1) for line in lines if (match := FLOAT64.match(line))]
        seen: dict[str, list[int]] = {}
        for k, line in enumerate(lines):
            for value in NAMED.findall(line) if ".reg" not in line else ():
                seen.setdefault(value, []).append(k)
        change = np.zeros(len(lines) + 1, dtype=int)
        for places in seen.values():
            change[places[0]] += 1
            change[places[-1]] -= 1
        operations = sum(SLOW if kind in ("div", "sqrt") else 1 for kind in kinds)
        out[name] = operations, sum(bool(MOVED.match(line)) for line in lines), int(np.cumsum(change).max())
    return out


def attempts(many: dict[str, tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Attempts and derivatives of each member."""
    members = model.simulate_many(model.load_action(), many, tolerance=TOLERANCE, workers=1, lanes=False)
    found = [m.solution.counters for m in members if m.solution is not None]
    return np.array([c["n_steps"] + c["n_rejected"] for c in found]), np.array([c["n_jacobian"] for c in found])


def main(run: Run) -> bool:
    """Count, and print the bounds; whether every kernel could be written."""
    scene = model.build_scene(model.load_action())
    kernels = counted(written(scene))
    table = Table("kernel:<9", "float64 operations:d", "loads and stores:d", "values alive:d")
    for name, (operations, moved, alive) in kernels.items():
        table.row(name, operations, moved, alive)
    tried, derived = attempts(trials(run.members))
    stages = METHODS["rodas4p"].stages
    calls = {"linearise": derived.mean()} | dict.fromkeys(("prepare", "skip", "fit", "end"), tried.mean())
    calls["stage"] = tried.mean() * stages
    operations, moved = (sum(calls[name] * kernels[name][k] for name in calls) for k in (0, 1))
    print(
        f"a forte at {TOLERANCE:g} rad: {tried.mean():.0f} attempts, {operations / 1e6:.1f} million operations, "
        f"{8 * moved / 1e6:.0f} MB moved; the workspace of a member takes {8 * SIZE / 1e3:.1f} kB"
    )
    for label, many in (("alike", trials(run.members)), ("unlike", unlike(run.members))):
        each, _ = attempts(many)
        warps = each[: len(each) // WARP * WARP].reshape(-1, WARP)
        print(
            f"{label}: a warp of {WARP} is busy for {(warps.mean(axis=1) / warps.max(axis=1)).mean():.2f} of its time"
        )
    start = time.process_time()
    model.simulate_many(model.load_action(), trials(run.members), tolerance=TOLERANCE, workers=1)
    here = run.members / (time.process_time() - start)
    threads = REGISTERS // min(2 * max(alive for _, _, alive in kernels.values()), MOST_REGISTERS + 1)
    bounds = Table(
        "device:<8", "members at once:d", "workspaces, MB:.0f", "second cache, MB:.0f", "fortes/s by float64:.0f",
        "by memory:.0f",
    )  # fmt: skip
    for name, (rate, memory, processors, cache) in DEVICES.items():
        at_once = processors * threads
        by_units, by_memory = rate * 1e12 / 2 / operations, memory * 1e9 / (8 * moved)
        bounds.row(name, at_once, 8e-6 * SIZE * at_once, cache, by_units, by_memory)
    print(f"one core here, in lanes: {here:.0f} fortes/s")
    return set(load.STEP) <= set(kernels) and here < min(by_units, by_memory)
