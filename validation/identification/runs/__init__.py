"""Runs of the model for a fit: curves of all trials, derivatives, and what each trial has of its own.

In: an action, what may move, trials as observed. Out: `model_runs.Response`. Trials are driven by their force
(`exact_runs`), by the motion of their key (`motion_runs`), or some by this and some by that (`responses`).
"""
