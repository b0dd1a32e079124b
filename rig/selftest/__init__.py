"""Self-test: wiring, signs, scales, delays and the watchdog of a bench, checked before it may record.

In: a rig file with ``[selftest]``, an open backend, the operator's hand on the key.
Out: a dated record with one finding a check, which recording on hardware demands.
"""
