"""Trials that the measured motion of the key drives, with or without a force beside it, and fits of both kinds.

In: measured trials. Out: what a fit compares of them (`key_driven`), and what the model says of it (`motion_runs`);
`responses` joins trials of both kinds.
"""
