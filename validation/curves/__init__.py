"""Measured and predicted curves as a reader gets them: one tidy table on one time base, a file of it, marks and plots.

In: traces of trials and predictions, events. Out: data frames, netCDF and Parquet files, matplotlib figures with the
thesis's signs.
"""
