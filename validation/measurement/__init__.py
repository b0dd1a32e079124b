"""What was measured: usable trials with corrected force, zeroed angles and their uncertainties.

In: a recorded session (`rig.session`), the geometry of the action under test, the condition of the trial plan.
Out: `measure_session.MeasuredSession`, one `trial.MeasuredTrial` for each usable trial, the reason for every other.
"""
