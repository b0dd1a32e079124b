"""What the page answers: one module for each part of it.

In: requests that passed `pianorig.page.access`. Out: JSON, pictures and reports; every failure is one line of JSON.
Work that takes longer than a moment is done in threads, so that the page goes on answering.
"""
