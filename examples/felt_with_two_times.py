"""A law of felt of your own: two memories that fade at different speeds, under the hammer.

Stulov's felt (J. Acoust. Soc. Am. 97, 1995, 2577: F = F0 [f - eps/tau integral of f exp((s - t)/tau) ds]) forgets in
one time. Felt is often fitted with a sum of exponentials instead. Here two layers lie side by side, each Stulov's,

    F = sum of w_i max(0, f - eps_i h_i) / (1 - eps_i),   tau_i dh_i/dt = f - h_i while layer i presses,

which is the hereditary law with two terms while both press: F0 = sum of w_i / (1 - eps_i), and each term's share is
w_i eps_i / (1 - eps_i) / F0. A layer whose surface lags comes back by itself: each is passive, and so is the sum.

Run:  python examples/felt_with_two_times.py
"""

from dataclasses import replace

import model
from model.compiler.expressions import ZERO, where
from model.elements.laws.curve import loading_force
from model.elements.laws.felt_law import Law, Number
from model.elements.laws.stulov import Stulov

LAYER = Stulov()


class TwoTimes(Law):
    """Two of Stulov's felts side by side."""

    name = "two-times"
    numbers = {
        "share": Number(0.5, "1", 0.2, 0.0, 1.0, "share of the slow curve that the first layer bears"),
        "epsilon1": Number(0.9, "1", 0.08, 0.0, 0.9999, "share of the first layer's force that fades"),
        "tau1": Number(2e-5, "s", 1e-5, 1e-9, 10.0, "time in which it fades"),
        "epsilon2": Number(0.5, "1", 0.2, 0.0, 0.9999, "share of the second layer's force that fades"),
        "tau2": Number(2e-3, "s", 1e-3, 1e-9, 10.0, "time in which it fades"),
    }

    def pack_numbers(self, contact, values, curve):
        """Two memories, and the numbers in the order above."""
        self.refuse_softening(contact, curve)
        return 2, tuple(values.values())

    def _layers(self, felt):
        """Share and felt of each layer."""
        share, *numbers = felt.numbers
        for k, weight in enumerate((share, 1.0 - share)):
            yield weight, replace(felt, memory=(felt.memory[k],), numbers=tuple(numbers[2 * k : 2 * k + 2]))

    def force(self, felt):
        """Whether a layer presses, and the sum of those that do."""
        (w1, one), (w2, two) = self._layers(felt)
        (on1, f1), (on2, f2) = LAYER.force(one), LAYER.force(two)
        return on1 | on2, w1 * where(on1, f1, 0.0) + w2 * where(on2, f2, 0.0)

    def rates(self, felt):
        """A layer follows the curve while it presses; its own surface comes back while only the other does."""
        layers = [layer for _, layer in self._layers(felt)]
        return [where(LAYER.force(x)[0], LAYER.rates(x)[0], LAYER.recovery_rates(x)[0]) for x in layers]

    def recovery_rates(self, felt):
        """Both surfaces come back."""
        return [LAYER.recovery_rates(layer)[0] for _, layer in self._layers(felt)]

    def energy(self, felt, label):
        """Sum of both."""
        before, stored, lost = [], ZERO, ZERO
        for k, (weight, layer) in enumerate(self._layers(felt)):
            more, kept, gone = LAYER.energy(layer, f"{label} layer {k}")
            before, stored, lost = [*before, *more], stored + weight * kept, lost + weight * gone
        return before, stored, lost

    def stiffness(self, felt):
        """Of a press too fast for either memory."""
        (w1, one), (w2, two) = self._layers(felt)
        return w1 * LAYER.stiffness(one) + w2 * LAYER.stiffness(two)

    def rest_memories(self, depth, curve, numbers, memories):
        """Both have come up to the curve."""
        return [loading_force(depth, curve)] * 2


def main() -> None:
    """Play a blow on hammer felts whose slow layer takes more and more of the force."""
    model.add_law(TwoTimes())
    action = model.load_action("hirschkorn2004-regulated").with_laws({"contact12": "two-times"})
    for share in (1.0, 0.5, 0.0):
        felt = action.with_values({"contact12.two-times.share": share})
        blow = model.simulate(felt, *model.force_table("forte"), energy=True, contact_forces=True)
        audit, force = blow.energy, blow.contact_normal_n[:, 11].max()
        print(f"share {share}: peak {force:.0f} N, felts lose {1e3 * audit.lost_in_felt:.1f} mJ, ", end="")
        print(f"energy closes to {abs(audit.residual) / audit.work_in:.0e} of the work")


if __name__ == "__main__":
    main()
