"""How far a predicted curve is from a measured one.

In: `prediction.predict_session.PredictedSession`, `events.session_events.SessionEvents`.
Out: `score_session.ScoredSession`: measured and predicted curves of every trial, and every score of every curve.
"""
