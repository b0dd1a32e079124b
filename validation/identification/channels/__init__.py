"""Channels beside encoders under a recorded force: trials that the motion of the key drives, bodies that a film shows.

In: measured trials. Out: what a fit compares of them (`key_driven`, `film_channels`).
"""
