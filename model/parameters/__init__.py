"""Parameter sets of an action: TOML files in, checked numbers with unit, uncertainty and source out, found by path."""
