"""The error budget of tracked angles: noise, reference, shutter, tilt, distortion, compression, synchronisation.

In: templates, poses, what is known of the camera. Out: standard uncertainties in rad, by term, frame and body.
"""
