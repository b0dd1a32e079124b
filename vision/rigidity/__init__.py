"""Whether what is tracked as one rigid body is one.

In: a prepared film and the poses found. Out: what moves against the rest of its own outline, px.
"""
