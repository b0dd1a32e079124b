"""Results that need not be computed again, under one key rule.

In: a kind of result, everything it depends on, and the code that computes it; `content_hash.result_key` makes one key.
Out: the stored result, or the computed one. Values and tables of a session are kept in its ``derived`` folder
(`result_store`), the inputs of a whole report beside it (`report_cache`).
"""
