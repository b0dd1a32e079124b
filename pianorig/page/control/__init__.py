"""A plan played from the page: begun, paused between two trials, resumed, aborted; what happens when nobody is there.

In: an order, and what the operator presses and types. Out: a session, recorded by a process of its own in the way
``pianorig record`` does, and where it is. The recorder's process decides by itself whether somebody is there: a page,
a browser or a server that stops answering can only make it pause.
"""
