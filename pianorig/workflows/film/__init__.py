"""Films beside a session: attaching them, proposing outlines, tracking, fitting single frames again.

In: a film file and what its header lacks; out: a film beside its trial, outlines, a table of angles that is also
stored in the session, pictures. Tracking itself is done by ``vision``.
"""
