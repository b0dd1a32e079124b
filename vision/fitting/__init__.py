"""Fit of one rigid body in one frame: templates, B-splines, the IC-GN fit, and the covariance of a pose."""
