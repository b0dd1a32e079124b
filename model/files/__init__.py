"""Files of the model: CSV columns and time tables in, figures out, named force tables, the one atomic writer."""
