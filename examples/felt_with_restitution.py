"""A law of felt of your own: it gives back the same share of any blow's speed, hard or soft.

Hunt and Crossley's damping (eq. 2.4 of the thesis) loses more of a hard blow. P. Flores, M. Machado, M. Silva and
J. Martins (Multibody Syst. Dyn. 25, 2011, 357), after H. Lankarani and P. Nikravesh (J. Mech. Des. 112, 1990, 369),
divide the rate by that of the first touch, v:

    F = f (1 + chi dx/dt / v),   chi = 8 (1 - e) / (5 e),

e being the share of its speed that a free body keeps. What is remembered is v: it follows the closing speed within
``tau``, and ceases to over the first ``layer`` of the depth, without a jump, so that derivatives of runs see none.
Below ``slowest`` a touch is none: felt at rest is damped as if it had been met at that speed.

Run:  python examples/felt_with_restitution.py
"""

from dataclasses import replace

import numpy as np

import model
from model.compiler.expressions import exponential, maximum
from model.elements.laws.felt_law import Law, Number
from model.elements.laws.hunt_crossley import HuntCrossley

DAMPED = HuntCrossley()


class Restitution(Law):
    """Hunt and Crossley's felt whose D is chi over the speed of the touch."""

    name = "restitution"
    numbers = {
        "e": Number(0.7, "1", 0.1, 0.05, 1.0, "share of its speed that a body keeps"),
        "tau": Number(1e-4, "s", 5e-5, 1e-6, 1.0, "time within which the speed of a touch is taken"),
        "layer": Number(2e-5, "m", 1e-5, 1e-7, 1e-3, "depth over which that speed ceases to be taken"),
        "slowest": Number(0.02, "m/s", 0.01, 1e-4, 10.0, "slowest touch that counts as a blow"),
    }

    def pack_numbers(self, contact, values, curve):
        """One memory; chi, one over tau, one over the layer, slowest."""
        chi = 8.0 * (1.0 - values["e"]) / (5.0 * values["e"])
        return 1, (chi, 1.0 / values["tau"], 1.0 / values["layer"], values["slowest"])

    def _damped(self, felt):
        chi, *_, slowest = felt.numbers
        return replace(felt, damping=chi / maximum(felt.memory[0], slowest))

    def force(self, felt):
        """As above."""
        return DAMPED.force(self._damped(felt))

    def recovery_rates(self, felt):
        """It follows the closing speed, pressing or not, until the surfaces are in each other."""
        within = maximum(felt.depth, 0.0) * felt.numbers[2]
        follows = exponential(maximum(-(within * within), -700.0))  # that an exponential takes
        return [(felt.rate - felt.memory[0]) * felt.numbers[1] * follows]

    def energy(self, felt, label):
        """The curve stores, the rest is lost."""
        return DAMPED.energy(self._damped(felt), label)

    def stiffness(self, felt):
        """Of a touch at the speed that is remembered."""
        return felt.curve[2] * (1.0 + felt.numbers[0])


def rebound(action: model.Action, blow: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Speed of the hammer, m/s, before the string and the share that it has after."""
    at = np.arange(0.0, float(blow[0][-1]), 1e-5)
    found = model.simulate(action, *blow, output_time_s=at, contact_forces=True, tolerance=1e-6)
    pressed = np.flatnonzero(found.contact_normal_n[:, 11] > 0.0)
    end = pressed[np.append(np.diff(pressed) > 1, True)][0] + 1
    speed = found.speed_rad_per_s[:, 4] * action["contact12.first.x"]
    return float(speed[pressed[0] - 1]), float(-speed[end] / speed[pressed[0] - 1])


def main() -> None:
    """Compare a soft and a hard blow."""
    model.add_law(Restitution())
    plain = model.load_action("hirschkorn2004-regulated")
    for law in ("hunt-crossley", "restitution"):
        action = plain.with_laws({"contact12": law})
        shares = [rebound(action, model.force_table(name)) for name in ("piano", "forte")]
        print(f"{law}:", *(f"{share:.3f} of {abs(speed):.2f} m/s," for speed, share in shares), "come back")


if __name__ == "__main__":
    main()
