"""Requested tolerance against true error of single blows.

Run:  python benchmarks/tolerance.py [--method NAME ...]
Prints per blow and method error / request at each request from 1e-3 to 1e-9, then the largest ratio of the errors of
neighbouring decades (0.5 or less: every decade at least halves the error). Blows marked ``tuned`` were used to choose
the shares in `model.simulation.run`, the ``held out`` ones were not. The error is the largest difference of any angle,
every 1 ms, from an explicit method of order 8 at 1e-13 that shares neither the equations' code nor the algorithm.
Exits with 1 if an error exceeds ten times its request.
With ``--sharp N`` instead N random sharp forces on several scenes (`sharp_forces`): how often the request is missed by
more than ten times, and how often a run with ``estimate_error`` says so; exits with 1 if over 2 % miss in silence.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # measure the checkout that contains this file

import numpy as np  # noqa: E402
from methods import COMPARISON  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from peers.compiled import CompiledEquations, pack  # noqa: E402
from peers.forces import BLOWS, force_table  # noqa: E402
from sharp_forces import sharp_forces  # noqa: E402

import model  # noqa: E402
from model.integrators.methods import METHODS  # noqa: E402

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
NAMES = (*BLOWS, "thesis-forte", *HELD_OUT)


def blow(name: str) -> tuple[Array, Array]:
    """Times (s) and forces (N)."""
    if name not in HELD_OUT:
        return force_table(name)
    time, _ = force_table("forte")
    at, newton = HELD_OUT[name]
    return time, np.round(np.interp(time, at, newton), 4)


def main(arguments: list[str] | None = None) -> int:
    METHODS.update(COMPARISON)
    p = argparse.ArgumentParser(description="Requested tolerance against true error.")
    p.add_argument("--method", action="append", choices=list(METHODS), help="only this method (may be repeated)")
    p.add_argument("--blow", action="append", choices=NAMES, help="only this blow (may be repeated)")
    p.add_argument("--sharp", type=int, metavar="N", help="N random sharp forces instead of the blows")
    p.add_argument("--first", type=int, default=0, metavar="K", help="leave out the first K of the sharp forces")
    p.add_argument("--seed", type=int, default=1, help="of the sharp forces")
    args = p.parse_args(arguments)
    if args.sharp:
        return 1 if 50 * sharp_forces(args.sharp, args.seed, args.first) > args.sharp else 0
    action = model.load_action()
    rest = model.rest_state(action)
    start = np.concatenate([rest.angle_rad, np.zeros(len(rest.angle_rad))])
    equations = CompiledEquations(action)
    bad: list[str] = []
    print(f"{'':9} {'blow':12} {'method':8}" + "".join(f"{t:9.0e}" for t in TOLERANCES) + "   decade   rejected, %")
    for name in args.blow or NAMES:
        time, force = blow(name)
        states, _ = equations.explicit(start, pack(time, force), OUTPUT_EVERY, REFERENCE_TOLERANCE)
        for method in args.method or METHODS:
            errors, share = [], []
            for tolerance in TOLERANCES:
                s = model.simulate(
                    action, time, force,
                    tolerance=tolerance, method=method, initial=rest, output_time_s=time[::OUTPUT_EVERY].copy(),
                )  # fmt: skip
                error = float(np.abs(s.angle_rad - states[:, : len(rest.angle_rad)]).max())
                errors.append(error)
                share.append(100.0 * s.counters["n_rejected"] / (s.counters["n_steps"] + s.counters["n_rejected"]))
                if not error <= ALLOWED * tolerance:
                    bad.append(f"{name}, {method} at {tolerance:.0e}: error {error:.1e} rad")
            steepest = max(b / a for a, b in zip(errors, errors[1:], strict=False))
            ratios = "".join(f"{e / t:9.2f}" for e, t in zip(errors, TOLERANCES, strict=True))
            print(
                f"{'tuned' if name in BLOWS else 'held out':9} {name:12} {method:8}{ratios}   {steepest:6.2f}   "
                f"{min(share):.1f} to {max(share):.1f}",
                flush=True,
            )
    for line in bad:
        print(f"ABOVE {ALLOWED:g} x the request  {line}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
