"""Compiled loops of map matching."""
