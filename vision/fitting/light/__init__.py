"""Light that changes over a body in any way: what it is in each square of the body, and from frame to frame.

In: residuals of a fit. Out: the frame under even light, and what that costs the pose.
"""
