"""The arm as a press: a felt loaded and released at several speeds and peak forces, or a block, for the compliance.

In: a rig file with ``[felt]``, what is pressed and how. Out: a session with one trial a press, and of each the loading
curve that ``pianorig calibrate-felt`` reads, corrected for arm and cell, with the errors all its points share.
"""
