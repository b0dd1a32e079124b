"""Files of the model: CSV columns and time tables in, figures out, named force tables, the one atomic writer.

Text files come in and checked arrays go out; a file that is written appears under its name only when it is complete.
Whatever cannot be read or written raises ``ModelInputError`` naming file, row and column.
"""
