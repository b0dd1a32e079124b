"""Laws of felt, a file each: parameters, force, memories, energy. `known` lists them; nothing else names one.

``felt_law`` is what a law may state; the force is ``force`` in the file of each; `model.elements.contacts` calls it.

How to write another, here or in a script of yours: docs/howto/contact_law.md.
"""
