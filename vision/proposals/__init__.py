"""Outlines proposed from the film itself: what moves as one is one body.

In: a film that begins with still frames. Out: outlines in film pixels, for the user to inspect, correct and name.
"""
