"""The largest errors of an angle that are asked for where nothing is said."""

DEFAULT_TOLERANCE = 1e-5  # rad: half a count of the key's encoder
MOTION_TOLERANCE = 1e-6  # rad, under a prescribed motion: contacts turn an error of an angle into a force on the key
