"""The moving action in a browser: its data, and the player that the page and exported animations share.

In: a motion seen, curves, events. Out: plain data for the page; or one HTML file with data and scripts in it, complete
in itself. The scripts in ``web`` are served by the page as they are and copied into each exported file.
"""
