"""Tracking of rigid bodies through a film, frame by frame and parents first."""
