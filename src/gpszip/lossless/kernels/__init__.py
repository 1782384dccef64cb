"""Compiled loops of the lossless columns."""
