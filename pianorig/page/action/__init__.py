"""The action to try out: screws and parameters turned, a blow at once, the touch, a technician's step, a file of it.

In: the name of a built-in action, a scene, and changed values by parameter path. Out: plain data; nothing is
kept between two requests, so that any number of pages may try any number of things. All mechanics is `model`'s.
"""
