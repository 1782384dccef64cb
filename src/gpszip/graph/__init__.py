"""Road graphs on arrays: canonical shortest paths and near nodes."""
