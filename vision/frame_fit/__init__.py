"""All bodies of one frame fitted in one compiled call, which leaves Python's lock to other threads."""
