"""Road graphs on arrays, with canonical shortest paths."""
