"""Parameter sets of an action: TOML files in, checked numbers with unit, uncertainty and source out, found by path.

`action` reads a set and changes values, `effects` adds the sections that a scene may switch on, `quantity` checks one
number, `scaling` multiplies by name or pattern, `write_toml` writes a set back.
"""
