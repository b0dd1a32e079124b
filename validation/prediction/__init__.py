"""What the model predicts: angles under each trial's own force, forces under its own motion, draws of its inputs.

In: `measurement.session.MeasuredSession` and the model under test (action, tolerance, rest state, geometry).
Out: `session.PredictedSession`, the angles predicted for each trial by the model and by the models it is compared with.
"""
