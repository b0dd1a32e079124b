"""The error budget of tracked angles: noise, reference, shutter, tilt, distortion, compression, synchronisation."""
