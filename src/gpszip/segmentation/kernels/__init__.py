"""Compiled loops of the (k,m)-segment mean."""
