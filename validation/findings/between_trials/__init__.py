"""Faults that show between trials: copies, mixed strokes, a change in mid-session, a trial the model alone finds odd.

In: all trials of a session and their predictions. Out: `finding.SessionFinding`, one module a rule.
"""
