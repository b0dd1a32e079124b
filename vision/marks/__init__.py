"""Points and lines that are followed where no whole body is to be tracked: a marker, the string, the edge of a felt.

In: marks drawn on the still frames, a film. Out: `vision.marks.follow.MarkResult`, positions in px with standard
uncertainties and flags.
"""
