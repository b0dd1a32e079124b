"""Fit of one rigid body in one frame: templates, B-splines, the IC-GN fit, and the covariance of a pose.

In: a frame, a template and a pose to start from. Out: `vision.fitting.base.Fit`, the pose with its covariance and
quality.
"""
