"""Points and lines that are followed where no whole body is to be tracked: a marker, the string, the edge of a felt."""
