"""The bodies to track: outlines drawn on the reference, their file, pixel masks, and which body hides which.

In: polygons from a TOML file. Out: masks of usable pixels, and the template pixels hidden in a frame.
"""
