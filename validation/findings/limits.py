"""Limits that several findings share."""

SIGMAS = 5.0  # standard uncertainties: Gaussian errors go beyond once in two million
NOISE_SIGMAS = 8.0  # of single readings, of which a record has ten thousands, with noise that has tails
SCALES_MAY = 0.05  # of a travel: choice; without faults ratios lie within 1 %
GROSS = 0.2  # of a travel: choice; beyond, a channel is left out of the scores
FAR = 0.01  # of a range, root mean square: choice, what is seen in a plot
END_S = 0.05  # of a record in which the action rests again; a bounce takes less
