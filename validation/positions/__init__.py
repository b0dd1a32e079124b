"""Sessions of positions without force: the measured key moves the model, and the hammer's position is the answer.

In: sessions whose trials hold position sensors (`rig`), an action, and an identified set where there is one. Out: a
`compare.PositionComparison` with scores of every stroke, a band calibrated on strokes that were not fitted, a page.
"""
