"""The posterior as draws: sampled where profiles are curved, else of the linear model; a file that ArviZ opens.

In: an identification. Out: `sample.Draws`; netCDF groups (`netcdf`). `curved` says which profiles are, `chains`
samples a density whose evaluations are done side by side.
"""
