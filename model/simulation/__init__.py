"""Runs of a scene: options, a run that can be stopped and resumed, its result, and static rest states."""
