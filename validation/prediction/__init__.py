"""What the model predicts: angles under each trial's own force, forces under its own motion, draws of its inputs."""
