"""When things happen in a keystroke, by the same definitions for a trial and for its prediction."""
