"""Pictures to check a tracking by eye: contact sheets of the worst frames, plots, frames to draw outlines on."""
