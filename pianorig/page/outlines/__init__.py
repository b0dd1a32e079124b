"""Outlines on a film, from the first proposal to angles: proposing, saving, tracking again, the frames to look at.

In: a film of a session's trial, or one that lies on its own in the folder of the sessions. Out: plain data; outlines
and tables where `pianorig track` has them.
"""
