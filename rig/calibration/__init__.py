"""Guided calibrations on the bench, the motor off: load cell, scale of an encoder, friction of a joint."""
