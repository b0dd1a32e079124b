"""Safety: what must be in order before the motor moves, and what stops it while it does.

In: predicted blow, self-test record, operator's confirmation; then every block of samples, and signals to the program.
Out: a refusal (:class:`rig.errors.NotPermitted`, :class:`rig.errors.RigInputError`) or an interlock fault.
"""
