"""Where a step must end: events of contacts and friction, rest, kinks of the input table.

In: the workspace of a step as ``linearise`` left it, and the input table; out: a shorter step, or a time.
"""
