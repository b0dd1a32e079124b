"""What is on the terminals of the virtual device: pulses and their edges, input readings, output levels.

In: the device's state and what the bench's sensors give at edges of the sample clock.
Out: samples, as an input task would acquire them, and the levels its outputs are at.
"""
