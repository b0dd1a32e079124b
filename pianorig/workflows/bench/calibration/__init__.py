"""Guided calibrations on the bench: the load cell, the friction of a joint.

In: a rig, a backend's address, what the operator is asked. Out: a rig or action file with the values found, a record.
"""
