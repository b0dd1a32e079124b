"""Work with the model alone or for the bench: inside view, key motion, studies, calibration, the dry run's prediction.

In: an action and tables of force or motion; out: plain rows for JSON, lines for the terminal, figures and tables on
disk. The mechanics is ``model``'s.
"""
