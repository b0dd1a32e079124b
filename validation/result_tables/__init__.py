"""Every table of the result: trials, channels, scores, events, budget, force from motion.

In: the records of all stages before, and which further runs are wanted (`options.ComparisonOptions`).
Out: `result.SessionTables`, data frames in SI units and radians."""
