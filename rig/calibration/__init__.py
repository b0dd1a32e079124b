"""Guided calibrations of the load cell, without the motor: dead weights, the bridge's shunt, the unloaded reading.

In: a rig file, an open backend, an operator who is asked. Out: a dated record with uncertainties, and the rig file with
the values that follow from it, which is how they are used.
"""
