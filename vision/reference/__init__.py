"""The reference of a film: how many frames at its start are at rest, their average, and a film prepared for tracking.

In: a film and the regions of its bodies. Out: the averaged picture with its noise, and the record that holds it
together with the bodies' templates.
"""
