"""What an identification gives: records of estimates and directions, and the action file that holds them.

In: what was found. Out: `result.Identification`, ``identified.toml``.
"""
