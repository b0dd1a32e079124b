"""The camera's view of the plane of motion: projection, calibration from a film of a target, and its file.

In: a film of a checkerboard or dots, or assumptions about tilt and lens. Out: a camera model that corrects angles and
states how uncertain the view is.
"""
