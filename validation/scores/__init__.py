"""How far a predicted curve is from a measured one.

In: `prediction.session.PredictedSession`, `events.session.SessionEvents`.
Out: `session.ScoredSession`: measured and predicted curves of every trial, and every score of every curve.
"""
