"""One trial under one time cursor: curves, film with outlines, the action moving as measured and as the model says.

In: a session's folder, a trial's number, names of models. Out: plain data and pictures; nothing is written, also no
prediction is kept. Numbers come from the same functions as the report's.
"""
