"""Compiled loops of the coreset."""
