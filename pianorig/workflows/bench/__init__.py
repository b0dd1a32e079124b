"""Work on the bench: permission, recording, films of the virtual bench, learning, self-test, watching, sessions.

In: a rig, a backend's address, profiles or recordings; out: session folders, learned profiles, records of
self-tests, facts as plain rows. Everything that moves is done by ``rig``.
"""
