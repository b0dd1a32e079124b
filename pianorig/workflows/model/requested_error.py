"""Whether a simulation delivers the error that was requested, in words."""

from __future__ import annotations

import model


def missed_request(solution: model.Solution) -> str:
    """What to say where the request is missed by more than ten times; empty where it is not, or was not estimated."""
    if solution.error_rad is None or not solution.misses_tolerance:
        return ""
    return (
        f"requested error missed: angles are off by about {solution.error_rad:.1e} rad, "
        f"{solution.error_rad / solution.tolerance:.0f} x the requested {solution.tolerance:g}: on this force small "
        "errors grow; tighten --tolerance, and do not trust the motion in detail where the two differ"
    )


def print_error(solution: model.Solution) -> None:
    """Estimated error beside the requested one."""
    if solution.error_rad is None:
        return
    print(missed_request(solution) or f"largest error of an angle about {solution.error_rad:.1e} rad, requested "
          f"{solution.tolerance:g}")  # fmt: skip
