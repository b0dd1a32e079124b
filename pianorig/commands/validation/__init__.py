"""Commands that compare measurement and prediction.

In: session folders and actions; out: ``report.html``, ``results.json`` and a verdict. The work is done by
``validation``.
"""
