"""What a few trials can tell: repeatability, bands, paired differences, budgets, comparison of models.

In: curves of several trials on one time base, events, scores.
Out: standard deviations, intervals and bands in the unit of what came in; no statistic removes a trial.
"""
