"""What to record next: which further trials, or which sensor known better, would shrink which interval.

In: an identification, strokes that could be played (`shelf`). Out: `shrink.Prospect`, ranked, and a trial plan for
``record --plan`` (`plan_file`).
"""
