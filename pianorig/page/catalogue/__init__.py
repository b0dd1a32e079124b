"""What the session folders hold, read from their files alone, and what the page may give out of them.

In: a folder of sessions, whatever lies in it. Out: plain rows for the table; a folder that cannot be read is a row that
says why. Nothing here is remembered on disk.
"""
