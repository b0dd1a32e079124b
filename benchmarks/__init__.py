"""Benchmarks of the project: `python -m benchmarks` lists them, `python -m benchmarks NAME` runs one."""
