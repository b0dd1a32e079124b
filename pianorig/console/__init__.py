"""The terminal's side of the commands: options they share, reading of their texts, progress, questions, output.

In: texts as typed, results as records; out: parsed values, lines on the terminal, JSON, column files whole or absent.
Nothing here imports NumPy when it is loaded, so that ``--help`` of any command stays fast.
"""
