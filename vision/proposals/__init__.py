"""Propose outlines from the film: motion segmentation of tracked points."""
