"""Requested tolerance against true error of single blows.

Prints per blow and method error / request at each request from 1e-3 to 1e-9, then the largest ratio of the errors of
neighbouring decades (0.5 or less: every decade at least halves the error). Blows ``held out`` were not used to choose
the shares in `model.simulation.run`. The error is the largest difference of any angle,
every 1 ms, from an explicit method of order 8 at 1e-13 that shares neither the equations' code nor the algorithm.
Wrong is an error above ten times its request.

With ``--sharp N`` instead N random sharp forces (corners to 60 N, white noise to 5 N, squares that change sign, a force
dropped within 0.2 ms, noise on a blow, zigzag) on the whole action, a lifting key and the motor arm, tolerances from
3e-4 to 1e-7: how often the request is missed by more than ten times, and how often a run with ``estimate_error`` says
so. The error is the difference from Rodas5P at 1e-11, which shares the equations' code but not the method; where errors
grow by more than 1e6 it is itself only one of the possible motions, and the request is missed by far whichever is
right. Wrong is more than 2 % that miss in silence.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

import model
from benchmarks.peers.compiled import BLOWS, CompiledEquations, force_table, pack
from benchmarks.runner import Run, Table
from model.integrators.methods import METHODS
from model.simulation.solution import MISSED

Array = NDArray[np.float64]

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
REFERENCE_TOLERANCE = 1e-13
OUTPUT_EVERY = 5  # points of the force table: 1 ms
ALLOWED = 10.0

# corners (s, N) of blows not used to choose any share
HELD_OUT: dict[str, tuple[list[float], list[float]]] = {
    "slow press": ([0, 0.02, 0.6, 0.65, 0.7], [0, 0, 3.0, 3.0, 0]),
    "staccato": ([0, 0.03, 0.045, 0.052, 0.055, 0.065, 0.7], [0, 0, 12, 30, 8, 0, 0]),
    "tremolo": (
        [0, 0.02, 0.05, 0.09, 0.14, 0.18, 0.22, 0.27, 0.31, 0.36, 0.42, 0.7],
        [0, 0, 9, 3, 0.5, 9, 3, 0.5, 10, 3, 0, 0],
    ),
}
DURATION_S, SAMPLE_S = 0.5, 2e-4  # of sharp forces
OUTPUTS = np.linspace(0.0, 0.49, 393)
SCENES = ("whole", "whole", "lifting-key", "motor-arm")
MOTOR_ARM_M = 0.1  # a force at the key's front as a torque of the motor
LABELS = {
    (False, False): "delivered, said nothing",
    (False, True): "delivered, warned (false)",
    (True, True): "missed, warned",
    (True, False): "missed, said nothing",
}

NAMES = (*BLOWS, "thesis-forte", *HELD_OUT)


def blow(name: str) -> tuple[Array, Array]:
    """Times (s) and forces (N)."""
    if name not in HELD_OUT:
        return force_table(name)
    time, _ = force_table("forte")
    at, newton = HELD_OUT[name]
    return time, np.round(np.interp(time, at, newton), 4)


def sharp_force(random: np.random.Generator) -> tuple[str, Array, Array]:
    """Kind, times (s) and forces (N)."""
    fine = np.arange(0.0, DURATION_S, SAMPLE_S)
    kind = ("corners", "noise", "square", "dropped", "noisy blow", "zigzag")[random.integers(0, 6)]
    if kind == "corners":
        inner = np.unique(np.round(random.uniform(0.01, 0.45, random.integers(3, 8)), 3))
        newton = random.uniform(0.0, random.choice([3.0, 8.0, 20.0, 60.0]), len(inner))
        return kind, np.concatenate([[0.0], inner, [DURATION_S]]), np.concatenate([[0.0], newton, [0.0]])
    if kind == "noise":
        return kind, fine, random.normal(0.0, random.uniform(0.1, 5.0), len(fine))
    if kind == "square":
        high = (fine * random.uniform(2.0, 20.0)) % 1.0 < 0.5
        return kind, fine, np.where(high, random.uniform(2.0, 15.0), random.choice([0.0, -3.0, -8.0]))
    if kind == "dropped":
        peak, until = random.uniform(5.0, 60.0), random.uniform(0.05, 0.25)
        at = np.array([0.0, 0.5 * until, until, until + SAMPLE_S, DURATION_S])
        return kind, at, np.array([0.0, peak, peak, 0.0, 0.0])
    if kind == "noisy blow":
        at, newton = [0.0, 0.03, random.uniform(0.06, 0.2), 0.3, 0.35], [0.0, 0.0, random.uniform(1.0, 25.0), 2.0, 0.0]
        return kind, fine, np.interp(fine, at, newton) + random.normal(0.0, 0.02, len(fine))
    at = np.linspace(0.0, DURATION_S, random.integers(10, 40))
    return kind, at, random.uniform(-3.0, 15.0, len(at))


def sharp_forces(count: int, seed: int = 1, first: int = 0) -> int:
    """Print each disagreement and both rates; returns how many runs missed their request without saying so.

    ``first`` runs of the sequence are left out, so that a long table can be made in parts.
    """
    random = np.random.default_rng(seed)
    action = model.load_action()
    seen = dict.fromkeys(LABELS, 0)
    plain_s = both_s = 0.0
    for k in range(first + count):
        kind, at, newton = sharp_force(random)
        scene = SCENES[random.integers(0, len(SCENES))]
        tolerance = 10.0 ** random.uniform(-7.0, -3.5)
        if k < first:
            continue
        if scene == "motor-arm":
            newton = newton * MOTOR_ARM_M
        choice = model.load_scene(scene)
        rest = model.rest_state(action, scene=model.build_scene(choice.on(action), choice))
        keywords = {"scene": scene, "output_time_s": OUTPUTS, "initial": rest}
        try:
            start = time.perf_counter()
            model.simulate(action, at, newton, tolerance=tolerance, **keywords)
            middle = time.perf_counter()
            done = model.simulate(action, at, newton, tolerance=tolerance, estimate_error=True, **keywords)
            end = time.perf_counter()
            exact = model.simulate(action, at, newton, tolerance=1e-11, method="rodas5p", **keywords)
        except model.IntegrationError as problem:
            print(f"  {k} {kind}, {scene}: {problem}")
            continue
        if k >= first + 8:  # not while kernels are being loaded
            plain_s, both_s = plain_s + middle - start, both_s + end - middle
        turning = [i for i, body in enumerate(done.bodies) if body != "key_lift"]
        error = float(np.abs(done.angle_rad - exact.angle_rad)[:, turning].max()) / tolerance
        outcome = (error > MISSED, done.misses_tolerance)
        seen[outcome] += 1
        if outcome[0] != outcome[1]:
            assert done.error_rad is not None
            words = f"error {error:.1f} x, estimated {done.error_rad / tolerance:.1f} x the request"
            print(f"  {k} {kind}, {scene}, {tolerance:.1e}: {words}", flush=True)
        if (k + 1) % 20 == 0 or k + 1 == first + count:
            print(f"runs {first} to {k}: " + ", ".join(f"{LABELS[key]} {n}" for key, n in seen.items()), flush=True)
    if plain_s:
        print(f"time with the estimate: {both_s / plain_s:.1f} x that without")
    return seen[True, False]


def main(run: Run) -> bool:
    """Print error over request; whether none is above what is allowed, of sharp forces all but 2 % said."""
    if run.sharp:
        return 50 * sharp_forces(run.sharp, run.seed, run.first) <= run.sharp
    action = model.load_action()
    rest = model.rest_state(action)
    start = np.concatenate([rest.angle_rad, np.zeros(len(rest.angle_rad))])
    equations = CompiledEquations(action)
    bad: list[str] = []
    worst: dict[str, float] = {}
    heads = (f"{t:.0e}:7.2f" for t in TOLERANCES)
    table = Table("blow:12s", "method:8s", *heads, "decade:.2f", "rejected %:.1f", "most:.1f", "held out:s")
    for name in run.blow or NAMES:
        time_s, force = blow(name)
        states, _ = equations.explicit(start, pack(time_s, force), OUTPUT_EVERY, REFERENCE_TOLERANCE)
        for method in run.method or METHODS:
            errors, share = [], []
            for tolerance in TOLERANCES:
                s = model.simulate(
                    action, time_s, force,
                    tolerance=tolerance, method=method, initial=rest, output_time_s=time_s[::OUTPUT_EVERY].copy(),
                )  # fmt: skip
                error = float(np.abs(s.angle_rad - states[:, : len(rest.angle_rad)]).max())
                errors.append(error)
                share.append(100.0 * s.counters["n_rejected"] / (s.counters["n_steps"] + s.counters["n_rejected"]))
                if not error <= ALLOWED * tolerance:
                    bad.append(f"ABOVE {ALLOWED:g} x the request  {name}, {method} at {tolerance:.0e}: {error:.1e} rad")
            steepest = max(b / a for a, b in zip(errors, errors[1:], strict=False))
            worst[method] = max(worst.get(method, 0.0), *(e / t for e, t in zip(errors, TOLERANCES, strict=True)))
            ratios = [e / t for e, t in zip(errors, TOLERANCES, strict=True)]
            table.row(name, method, *ratios, steepest, min(share), max(share), "" if name in BLOWS else "yes")
    run.figure("tolerance", "; ".join(f"{worst[name]:.2f}" for name in ("rodas4p", "rodas5p") if name in worst))
    print("\n".join(bad))
    return not bad
