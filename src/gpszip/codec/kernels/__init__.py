"""Compiled loops of the walk codec."""
