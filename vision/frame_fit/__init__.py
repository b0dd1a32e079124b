"""All bodies of one frame fitted in one compiled call, which leaves Python's lock to other threads.

In: what does not change of the bodies (`compiled.Bodies`), where they were (`compiled.States`) and the filtered part of
a frame. Out: poses and what the fits say of themselves (`compiled.Found`), for bodies of which nothing is doubtful; at
the first other one the call ends and Python decides.
"""
