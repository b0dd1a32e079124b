"""Laws of felt that remembers, as a contact under way needs them: force, rate of the memory, their derivatives.

f(x) = a x^3 + b x^2 + c x is the felt's slow loading curve. Stulov: F = (f - eps h) / (1 - eps), the memory h (N)
follows f within tau. Hysteresis: F = f (1 + sum of beta z) / (1 + sum of beta), each memory z follows the direction of
the press within eta x. Equations, passivity and rules: docs/decisions/0191-felt-laws-in-the-action.md.
"""

from model.kernels.compile import inlined
from model.kernels.laws import friction

LONGEST_MEMORY = 1e-3  # s, for which an error of a memory is taken to act at most: a blow's contact
NEWTON_STEPS = 60


@inlined
def loading_curve(x, a, b, c):
    """Slow loading force (N) at a depth above 0, and its slope (N/m)."""
    return max(0.0, ((a * x + b) * x + c) * x), (3.0 * a * x + 2.0 * b) * x + c


@inlined
def stulov_open(h, epsilon, tau):
    """Rate of a memory whose felt is left alone: its own surface comes back."""
    return -(1.0 - epsilon) * h / tau


@inlined
def stulov(x, h, a, b, c, epsilon, tau):
    """Force of felt with the memory ``h`` (N) and the rate of the memory; the felt cannot pull."""
    f, _ = loading_curve(x, a, b, c)
    if f <= epsilon * h:
        return 0.0, stulov_open(h, epsilon, tau)
    return (f - epsilon * h) / (1.0 - epsilon), (f - h) / tau


@inlined
def stulov_slopes(x, h, a, b, c, epsilon, tau):
    """The same with derivatives: force, by depth, by memory; rate, by depth, by memory."""
    f, slope = loading_curve(x, a, b, c)
    if f <= epsilon * h:
        return 0.0, 0.0, 0.0, stulov_open(h, epsilon, tau), 0.0, -(1.0 - epsilon) / tau
    hard = 1.0 / (1.0 - epsilon)
    return (f - epsilon * h) * hard, slope * hard, -epsilon * hard, (f - h) / tau, slope / tau, -1.0 / tau


@inlined
def hysteresis_rate(x, rate, z, reach):
    """Rate of a memory that follows the direction of the press."""
    return (rate - abs(rate) * z) / (reach * x)


@inlined
def hysteresis_slopes(x, rate, z, reach):
    """Rate of the memory and its derivatives by depth, by its rate, by the memory."""
    per = 1.0 / (reach * x)
    way = 0.0
    if rate > 0.0:
        way = 1.0
    elif rate < 0.0:
        way = -1.0
    follow = (rate - abs(rate) * z) * per
    return follow, -follow / x, (1.0 - way * z) * per, -abs(rate) * per


@inlined
def remembered_error(push, fade):
    """Error of a speed that one unit of a memory is worth: acceleration ``push`` while it lasts."""
    return push * min(LONGEST_MEMORY, 1.0 / max(1e-300, -fade))


@inlined
def rubbing_force(fn, slide, nx, ny, per_v, mu_a, mu_b1, mu_b2):
    """World force on A of a contact that presses with ``fn``."""
    ft = 0.0
    if fn > 0.0 and mu_a != 0.0:
        mu, _ = friction(slide, per_v, mu_a, mu_b1, mu_b2)
        ft = -mu * fn
    return fn * nx - ft * ny, fn * ny + ft * nx


@inlined
def rubbing(fn, slide, per_v, mu_a, mu_b1, mu_b2):
    """Friction coefficient of a contact that presses with ``fn``, and its derivative."""
    if fn > 0.0 and mu_a != 0.0:
        return friction(slide, per_v, mu_a, mu_b1, mu_b2)
    return 0.0, 0.0


@inlined
def stored_slowly(x, a, b, c):
    """Energy (J) of felt pressed in slowly."""
    return x * x * (0.5 * c + x * (b / 3.0 + 0.25 * a * x))


@inlined
def depth_of(force, a, b, c):
    """Depth (m) at which slow loading takes ``force``: Newton's iteration kept between bounds, for the curve rises."""
    if force <= 0.0:
        return 0.0
    low, high = 0.0, 1e-6
    while high < 1.0 and loading_curve(high, a, b, c)[0] < force:
        low, high = high, 2.0 * high
    x = high
    for _ in range(NEWTON_STEPS):
        f, slope = loading_curve(x, a, b, c)
        if f < force:
            low = x
        else:
            high = x
        there = x - (f - force) / slope if slope > 0.0 else low
        if not low < there < high:
            there = 0.5 * (low + high)
        if abs(there - x) <= 1e-15 * x:
            break
        x = there
    return x


@inlined
def stulov_energy(x, h, a, b, c, epsilon, tau):
    """Stored energy (J) and lost power (W) of felt with memory ``h``, touched or not."""
    surface = max(x, depth_of(epsilon * h, a, b, c))
    inner = depth_of(h, a, b, c)
    f, _ = loading_curve(surface, a, b, c)
    hard = 1.0 / (1.0 - epsilon)
    bound = h * surface - (h * inner - stored_slowly(inner, a, b, c))
    lost = epsilon * (surface - inner) * (f - h) / tau
    return (stored_slowly(surface, a, b, c) - epsilon * bound) * hard, lost * hard


@inlined
def hysteresis_energy(x, rate, z, share, reach, a, b, c):
    """Energy (J) that one memory stores and power (W) that it takes, both times one plus all shares."""
    f, slope = loading_curve(x, a, b, c)
    stored = 0.5 * share * reach * x * f * z * z
    return stored, share * z * z * (f * abs(rate) - 0.5 * reach * (f + x * slope) * rate)
