"""Compressing a stream that has no end: batch by batch, with an archive that is always whole."""
