"""The bench: motor profiles, channels, backends, DAQ tasks, interlocks, the recorder and session files.

Place in the data flow: profile → ``rig`` → session folder (raw, sealed) → ``vision`` → ``validation``.
Importing this package loads nothing heavy; the NI-DAQmx client is loaded only when a backend is opened, the
virtual bench (``rig.simulated``) only for a ``sim://`` address.
"""
