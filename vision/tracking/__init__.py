"""Tracking of rigid bodies through a film, frame by frame and parents first.

In: a film and the outlines of its bodies. Out: `vision.results.track_result.TrackResult`. The entrance is
`vision.tracking.track_film.track`.
"""
