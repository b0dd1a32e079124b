"""The camera's view of the plane of motion: projection, calibration from a film of a target, and its file."""
