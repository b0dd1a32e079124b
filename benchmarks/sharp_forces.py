"""Random sharp forces on several scenes: is the requested error delivered, and does a run say when it is not?

Part of ``python benchmarks/tolerance.py --sharp N [--first K]``. Forces: random corners to 60 N, white noise to 5 N,
squares that change sign, a force dropped within 0.2 ms, noise on a blow, random zigzag; scenes: the whole action, a
lifting key, the motor arm; tolerances from 3e-4 to 1e-7. The error is the largest difference of any angle from Rodas5P
at 1e-11, which shares the equations' code but not the method; where errors grow by more than 1e6 it is itself only one
of the possible motions, and the request is missed by far whichever is right.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

import model
from model.simulation.solution import MISSED

Array = NDArray[np.float64]

DURATION_S, SAMPLE_S = 0.5, 2e-4
OUTPUTS = np.linspace(0.0, 0.49, 393)
SCENES = ("whole", "whole", "lifting-key", "motor-arm")
MOTOR_ARM_M = 0.1  # a force at the key's front as a torque of the motor
REFERENCE_TOLERANCE = 1e-11
LABELS = {
    (False, False): "delivered, said nothing",
    (False, True): "delivered, warned (false)",
    (True, True): "missed, warned",
    (True, False): "missed, said nothing",
}


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
            exact = model.simulate(action, at, newton, tolerance=REFERENCE_TOLERANCE, method="rodas5p", **keywords)
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
