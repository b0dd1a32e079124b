"""Laws of felt, a file each: parameters, force, memories, energy. `known` lists them; nothing else names one.

How to write another, here or in a script of yours: docs/howto/contact_law.md.
"""
