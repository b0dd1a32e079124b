"""What tracking gives: poses of every body in every frame, flags of frames that failed, and the result for the user.

In: fits of single bodies in single frames. Out: `vision.results.track_result.TrackResult`, angles in rad with standard
uncertainties and flags.
"""
