"""The largest error of an angle that is asked for where nothing is said."""

DEFAULT_TOLERANCE = 1e-5  # rad: half a count of the key's encoder
