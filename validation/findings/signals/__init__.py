"""Faults of single channels: force, its sign, unit, delay, drift and range; encoders, their travel, return and bits.

In: `measurement.trial.MeasuredTrial`, its prediction and events. Out: `finding.SessionFinding`, one module a rule, with
the limit below which it is silent.
"""
