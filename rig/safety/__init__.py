"""Safety: what must be in order before the motor moves, and what stops it while it does."""
