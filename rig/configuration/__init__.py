"""Configuration: rig files, motor profiles and the TOML they are written in, checked when they are read."""
