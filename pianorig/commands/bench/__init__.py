"""Commands of the bench: recording, its simulation and self-test, sessions and what is noted about them.

In: options as typed; out: session folders, profiles, records of self-tests, lines or JSON on standard output.
The work is done by ``pianorig.workflows.bench`` and ``rig``.
"""
