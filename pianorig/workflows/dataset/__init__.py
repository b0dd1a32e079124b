"""The published data set: strokes of the virtual bench on two specimens, their sensors, faults and metadata.

In: a seed, or none for the sealed split. Out: a folder of netCDF-4 files with what describes them, and the truth apart.
"""
