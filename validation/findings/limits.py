"""Limits that several findings share."""

SCALES_MAY = 0.05  # of a travel: choice; without faults ratios lie within 1 %
GROSS = 0.2  # of a travel: choice; beyond, a channel is left out of the scores
FAR = 0.01  # of a range, root mean square: choice, what is seen in a plot
