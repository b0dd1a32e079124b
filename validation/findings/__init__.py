"""What is wrong with a session or looks wrong with the model: wiring, clocks, hum, lifts, odd trials, friction.

In: `PredictedSession`, `SessionEvents` and `ScoredSession` of `prediction`, `events` and `scores`.
Out: `find_faults.SessionFindings`: one line for each fault, and which trials no pooled figure may count.
"""
