"""The terminal's side of the commands: options they share, reading of their texts, progress, questions, output.

Nothing here imports NumPy when it is loaded, so that ``--help`` of any command stays fast.
"""
