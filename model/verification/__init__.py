"""Independent checks of the compiled equations, in plain NumPy straight from an `Action`, without any kernel.

In: an action and states or a motion; out: forces, energies and powers, and an energy balance over time.
"""
