"""The reference of a film: how many frames at its start are at rest, their average, and a film prepared for tracking."""
