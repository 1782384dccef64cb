"""Read logs larger than memory: sort them into temporary files, from which slices are read."""
