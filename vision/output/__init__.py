"""Pictures to check a tracking by eye: overlay films, contact sheets of the worst frames, plots, drawn outlines.

In: a film and its `vision.results.track_result.TrackResult`. Out: image files; nothing is computed from them.
"""
