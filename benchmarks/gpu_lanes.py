"""What would batches on a graphics processor need, and at what rate would they run?

The kernels of the default scene are written for NVIDIA's instruction set from the same text as for this processor (a
thread is a member), and counted: operations on float64, loads and stores, values alive at once. With the work of a
forte they give bounds of the rate: by the float64 units (a division or root counts `SLOW` operations), and by the
memory, if the workspace of a step is read from there each time. Threads of a warp wait for each other: members that
each take their own steps keep it busy for the mean of their attempts over the largest; members that follow each other
in a lane, as they do here, do not wait. All contacts count as evaluated, since one thread that needs one makes all
wait. With a CUDA device ``linearise`` also runs there, against this processor's numbers; without one that is skipped.
"""

from __future__ import annotations

import ctypes
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
from model.kernels import workspace as W
from model.kernels.workspace import SIZE
from model.scene.build import Scene

TRIPLE, KIND = "nvptx64-nvidia-cuda", "sm_80"
WARP, SLOW = 32, 10
BLOCK = 128
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
ENTRY = """
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
define ptx_kernel void @many(ptr %w, ptr %p, double %u, i64 %members, i64 %size) {
  %t = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %b = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %n = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %bn = mul i32 %b, %n
  %i = add i32 %bn, %t
  %m = zext i32 %i to i64
  %in = icmp slt i64 %m, %members
  br i1 %in, label %go, label %done
go:
  %at = mul i64 %m, %size
  %mine = getelementptr double, ptr %w, i64 %at
  %r = call i64 @linearise(ptr %mine, ptr %p, double %u)
  br label %done
done:
  ret void
}
"""
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
    module = binding.parse_assembly(text + ENTRY)
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
    code = written(scene)
    kernels = counted(code)
    table = Table("kernel:<9", "float64 operations:d", "loads and stores:d", "values alive:d")
    for name, (operations, moved, alive) in kernels.items():
        table.row(name, operations, moved, alive)
    tried, derived = attempts(trials(run.members))
    stages = METHODS["rodas4p"].stages
    calls = {"linearise": derived.mean()} | dict.fromkeys(("prepare", "skip", "fit", "end"), tried.mean())
    calls["stage"] = tried.mean() * stages
    operations, moved = (sum(calls[name] * kernels[name][k] for name in calls) for k in (0, 1))
    print(
        f"a forte at {TOLERANCE:g} rad: {tried.mean():.0f} attempts, {operations / 1e6:.1f} million operations, ",
        end="",
    )
    print(f"{8 * moved / 1e6:.0f} MB moved; the workspace of a member takes {8 * SIZE / 1e3:.1f} kB")
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
    print(on_device(code, scene, run.members))
    return set(load.STEP) <= set(kernels) and here < min(by_units, by_memory)


def on_device(code: str, scene: Scene, members: int) -> str:
    """Run ``linearise`` of many members on a CUDA device and compare with this processor; a line on what came out."""
    try:
        cuda = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return "skipped on a device: no CUDA driver (libcuda.so.1) on this machine"
    count = ctypes.c_int(0)
    if cuda.cuInit(0) or cuda.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return "skipped on a device: the CUDA driver finds none"

    def done(status: int, what: str) -> None:
        if status:
            raise SystemExit(f"CUDA: {what} ended with status {status}")

    start = model.rest_state(model.load_action())
    own = np.zeros((members, SIZE))
    own[:, W.Q : W.Q + scene.size] = start.angle_rad
    own[:, W.V : W.V + scene.size] = np.random.default_rng(1).normal(0.0, 1.0, (members, scene.size))
    expected, linearise = own.copy(), load.kernels_of(scene.tables).linearise
    for row in expected:
        linearise(row, scene.vector, 5.0)
    context, module, kernel, device = (ctypes.c_void_p() for _ in range(4))
    done(cuda.cuDevicePrimaryCtxRetain(ctypes.byref(context), 0), "the context")
    done(cuda.cuCtxSetCurrent(context), "the context")
    done(cuda.cuModuleLoadData(ctypes.byref(module), code.encode()), "compiling the kernel")
    done(cuda.cuModuleGetFunction(ctypes.byref(kernel), module, b"many"), "the kernel")
    registers, local = ctypes.c_int(), ctypes.c_int()
    cuda.cuFuncGetAttribute(ctypes.byref(registers), 4, kernel)
    cuda.cuFuncGetAttribute(ctypes.byref(local), 3, kernel)
    places = []
    for array in (own, np.ascontiguousarray(scene.vector)):
        done(cuda.cuMemAlloc_v2(ctypes.byref(device), ctypes.c_size_t(array.nbytes)), "memory")
        done(
            cuda.cuMemcpyHtoD_v2(device, array.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(array.nbytes)), "a copy"
        )
        places.append(ctypes.c_void_p(device.value))
    given = (*places, ctypes.c_double(5.0), ctypes.c_longlong(members), ctypes.c_longlong(SIZE))
    pointers = (ctypes.c_void_p * len(given))(*(ctypes.cast(ctypes.byref(x), ctypes.c_void_p) for x in given))
    blocks = -(-members // BLOCK)
    began = time.perf_counter()
    done(cuda.cuLaunchKernel(kernel, blocks, 1, 1, BLOCK, 1, 1, 0, None, pointers, None), "the launch")
    done(cuda.cuCtxSynchronize(), "the run")
    seconds = time.perf_counter() - began
    size = ctypes.c_size_t(own.nbytes)
    done(cuda.cuMemcpyDtoH_v2(own.ctypes.data_as(ctypes.c_void_p), places[0], size), "a copy")
    off = float(np.max(np.abs(own - expected) / (1.0 + np.abs(expected))))
    if not off < 1e-9:
        raise SystemExit(f"the device's numbers are {off:.1e} from this processor's")
    return (
        f"on the device: {registers.value} registers, {local.value} bytes spilled a thread; {members} states in "
        f"{1e3 * seconds:.2f} ms, at most {off:.0e} from this processor's numbers"
    )
