"""What is wrong with a session or looks wrong with the model: wiring, clocks, hum, lifts, odd trials, friction.

In: `prediction.session.PredictedSession`, `events.session.SessionEvents`, `scores.session.ScoredSession`.
Out: `session.SessionFindings`: one line for each fault, and which trials no pooled figure may count.
"""
