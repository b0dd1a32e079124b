"""The journal of the trial in progress: written block by block, read back by recovery and by a live view.

In: the trial's head and its blocks, as they are acquired.
Out: ``trial_NNNN.journal``, removed once the trial is sealed.
"""
