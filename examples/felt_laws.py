"""Which laws do presses of a felt rule out? Each is judged on every press by parameters fitted to the others.

Run:  pianorig examples . && python examples/felt_laws.py presses/*.csv

A law is ruled out where it is farther from presses it was not fitted to than the nearest law is, by more than chance:
an exact test over presses (signs of the logarithm of the ratio of errors flipped), Holm's rule over the laws, and by
more than 5 % of the error. Presses of one speed cannot separate Hunt and Crossley's law from the others.
"""

import sys

import numpy as np
from scipy.stats import permutation_test

import model

LEVEL = 0.05
ALIKE = 1.05  # ratio of errors below which a law is as good in practice, whatever the test finds


def compare_laws(fits: list[model.felt.LawFit]) -> dict[str, float]:
    """Holm's p of each law against the nearest one, 1 for that one; laws by their held-out error."""
    nearest, *others = sorted(fits, key=lambda fit: fit.typical_held_out)
    p = {}
    for fit in others:
        ratio = np.log(fit.held_out / nearest.held_out)
        p[fit.kind] = float(permutation_test((ratio,), np.mean, permutation_type="samples", n_resamples=2**14).pvalue)
    adjusted, largest = {nearest.kind: 1.0}, 0.0
    for k, kind in enumerate(sorted(p, key=p.__getitem__)):
        largest = max(largest, min(1.0, (len(p) - k) * p[kind]))
        adjusted[kind] = largest
    return adjusted


def main(paths: list[str]) -> None:
    presses = [model.felt.read_pressing(path) for path in paths]
    fits = [model.felt.fit_law(kind, presses) for kind in model.felt.LAWS]
    p, nearest = compare_laws(fits), min(fits, key=lambda fit: fit.typical_held_out)
    print(f"{len(presses)} presses, {'held out':>14} {'fitted':>8} {'p':>8}")
    for fit in sorted(fits, key=lambda fit: fit.typical_held_out):
        print(f"{fit.kind:<15} {fit.typical_held_out:>12.2%} {float(fit.misfit.mean()):>8.2%} {p[fit.kind]:>8.2g}")
    far = [fit.kind for fit in fits if fit.typical_held_out > ALIKE * nearest.typical_held_out]
    out = [kind for kind in far if p[kind] <= LEVEL]
    if (len(fits) - 1) * 2.0 ** (1 - len(presses)) > LEVEL:
        print(f"{len(presses)} presses rule nothing out; record more, at other speeds and peak forces")
    else:
        print(f"ruled out: {', '.join(out) or 'none'}; nearest: {nearest.kind}")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        raise SystemExit("felt_laws: found fewer than three presses, allowed three or more CSV files")
    main(sys.argv[1:])
