"""What the model predicts: angles under each trial's own force, forces under its own motion, draws of its inputs.

In: `measurement.measure_session.MeasuredSession` and the model under test (action, tolerance, rest state, geometry).
Out: `predict_session.PredictedSession`, the angles predicted for each trial by the model and by those it is compared
with.
"""
