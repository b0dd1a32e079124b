"""Configuration: rig files, motor profiles and the TOML they are written in, checked when they are read.

In: TOML files (built in: ``rig/rigs``, ``rig/profiles``).
Out: frozen :class:`~rig.configuration.rig_file.Rig` and :class:`~rig.configuration.profile.Profile`; motor commands, V.
"""
