"""A recording seen while another process makes it: from its journal, which is read and never touched.

In: the folder of the session that is being recorded. Out: what is new since the last look, as samples by channel, and
where the recording is. Nothing here can slow or end a recording.
"""
