"""The reference of a film: its still frames, their average, and a film prepared for tracking."""
