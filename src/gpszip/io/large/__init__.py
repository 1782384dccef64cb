"""Logs larger than memory: read in batches, sorted on disk, read again in slices."""
