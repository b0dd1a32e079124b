"""When things happen in a keystroke, by the same definitions for a trial and for its prediction.

In: `measurement.stroke.Motion` of a trial or a prediction, `prediction.predict_session.PredictedSession`.
Out: `session_events.SessionEvents`: events of all trials and predictions, lifts of the key, the evaluation window.
"""
