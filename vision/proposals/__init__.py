"""Propose outlines from the film: motion segmentation of tracked points.

In: a film that begins with still frames. Out: outlines in film pixels, for the user to inspect, correct and name.
"""
