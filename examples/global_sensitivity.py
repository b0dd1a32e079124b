"""Which parameters decide about a blow over their uncertainties: Morris screening and Sobol' indices by SALib.

Run:  python -m pip install -e ".[sensitivity]" && python examples/global_sensitivity.py [--morris 10] [--sobol 64]

Morris's method ranks parameters with few runs: mu_star is the mean size of the effect, sigma how far it is curved or
mixed with others. Sobol' indices say what share of the variance each parameter is responsible for, alone (S1) and with
all others (ST). Finished runs lie in the folder of --store: the same command goes on where it stopped.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from SALib.analyze import morris as analyze_morris
from SALib.analyze import sobol as analyze_sobol
from SALib.sample import morris as sample_morris
from SALib.sample import sobol as sample_sobol

import model

PARAMETERS = ("hammer.mass", "key.inertia", "repetition_spring.stiffness", "key.joint_friction.A", "contact08.second.y")
OUTPUTS = ("strike speed (m/s)", "strike time (s)")
SAMPLE_HZ = 5000.0
EDGE_SD = 3.0
"""Draws are cut at so many standard uncertainties."""


def main() -> None:
    """Draw the designs, simulate their members in lanes, print the indices."""
    parser = argparse.ArgumentParser(description="Global sensitivities of a forte blow.")
    parser.add_argument("--morris", type=int, default=10, help="trajectories; each takes P + 1 runs")
    parser.add_argument("--sobol", type=int, default=64, help="base members, a power of 2; n (P + 2) runs")
    parser.add_argument("--store", help="folder that keeps finished runs")
    options = parser.parse_args()
    action = model.load_action("hirschkorn2004-regulated")
    quantities = [action.quantities[path] for path in PARAMETERS]
    problem = {
        "names": list(PARAMETERS),
        "num_vars": len(PARAMETERS),
        "bounds": [[q.value - EDGE_SD * q.u, q.value + EDGE_SD * q.u, q.value, q.u] for q in quantities],
        "dists": ["truncnorm"] * len(PARAMETERS),
    }
    for name, sample, analyze, columns in (
        (f"Morris, {options.morris} trajectories", sample_morris.sample(problem, options.morris, seed=1),
         analyze_morris.analyze, ("mu_star", "mu_star_conf", "sigma")),
        (f"Sobol', {options.sobol} base members",
         sample_sobol.sample(problem, options.sobol, calc_second_order=False, seed=1),
         lambda problem, _, y: analyze_sobol.analyze(problem, y, calc_second_order=False, seed=1),
         ("S1", "S1_conf", "ST", "ST_conf")),
    ):  # fmt: skip
        outputs = simulate_outputs(action, sample, options.store)
        print(f"{name}: {len(sample)} runs")
        for k, output in enumerate(OUTPUTS):
            print(f"  {output:<30}" + "".join(f"{column:>14}" for column in columns))
            indices = analyze(problem, sample, outputs[:, k])
            for j in np.argsort(-np.asarray(indices[columns[-2] if "ST" in columns else "mu_star"])):
                row = "".join(f"{float(indices[column][j]):>14.4g}" for column in columns)
                print(f"  {PARAMETERS[j]:<30}{row}")


def simulate_outputs(action: model.Action, sample: NDArray[np.float64], store: str | None) -> NDArray[np.float64]:
    """Speed and time of the first strike of each member of a sample (n, P); shape (n, 2)."""
    blow = model.force_table("forte")
    members = model.simulate_many(
        action,
        {"forte": blow},
        [dict(zip(PARAMETERS, row.tolist(), strict=True)) for row in sample],
        tolerance=1e-7,  # differences between members are small: their errors have to be smaller
        output_time_s=np.arange(0.0, 0.2, 1.0 / SAMPLE_HZ),
        store=store,
    )
    outputs = np.empty((len(sample), len(OUTPUTS)))
    for i, member in enumerate(members):
        if member.solution is None:
            raise SystemExit(f"member {i}: {member.error}; narrow the uncertainties and run again")
        variant = action.with_values(dict(zip(PARAMETERS, sample[i].tolist(), strict=True)))
        blow = replace(member.solution, action=variant)  # members of a batch come without theirs
        height_m = blow.hammer_height_m
        strikes = np.flatnonzero((height_m[:-1] > 0) & (height_m[1:] <= 0))
        if not strikes.size:
            raise SystemExit(f"member {i}: the hammer does not strike; choose narrower uncertainties")
        k = int(strikes[0])  # the last sample in free flight; the height falls at the approach speed from there
        approach = blow.hammer_approach_m_per_s
        wait_s = height_m[k] / approach[k]
        slowing = (approach[k] - approach[k - 1]) * SAMPLE_HZ
        outputs[i] = approach[k] + slowing * wait_s, blow.time_s[k] + wait_s
    return outputs


if __name__ == "__main__":
    main()
