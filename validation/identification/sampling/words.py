"""What draws say beside the intervals of the linear model and the profiles, in lines."""

from __future__ import annotations

from validation.identification.outcome.result import Identification
from validation.identification.sampling.sample import Draws


def draw_lines(found: Identification, draws: Draws) -> list[str]:
    """Lines on the draws: whether any profile is curved, how they were made, 95 % of the draws of each parameter.

    Parameters
    ----------
    found : Identification
    draws : Draws

    Returns
    -------
    list of str

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> validation.draw_lines(found, validation.sample_posterior(found))
    ['posterior: no profile was made; its draws are those of the linear model']
    """
    if not draws.sampled:
        why = "no profile is curved" if found.details.profiles else "no profile was made"
        return [f"posterior: {why}; its draws are those of the linear model"]
    bent = f"profiles are curved ({', '.join(draws.curved)})" if draws.curved else "no profile is curved"
    mixed = "" if draws.mixed else "; the chains did NOT mix: do not use them"
    head = (
        f"posterior: {bent}; {draws.directions} directions sampled, {100 * draws.accepted:.0f} % of proposals "
        f"accepted, R-hat {draws.r_hat:.2f}{mixed}"
    )
    problem = found.details.problem
    lines = [head]
    for j, (p, e) in enumerate(zip(problem.unknowns.asked, found.estimates, strict=True)):
        low, high = sorted(p.physical(problem.action, z) for z in draws.interval(j))
        lines.append(
            f"{e.name}: 95 % of the draws {low:.4g} to {high:.4g}, stated interval {e.low:.4g} to {e.high:.4g} "
            "(draws take sizes of noise as known)"
        )
    return lines
