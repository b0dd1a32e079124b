"""Pictures to check a tracking by eye: overlay films, contact sheets of the worst frames, plots, drawn outlines."""
