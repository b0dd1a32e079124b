"""Trials that the measured motion of the key drives, with or without a force beside it.

In: measured trials. Out: what a fit compares of them (`key_driven`).
"""
